"""The metrics that an expectation may bound, and what each means.

How several values become one
-----------------------------
An expectation that names nodes or links must hold for **each** of them: ``at_most`` is held against the
largest value, ``at_least`` against the smallest, ``equals`` against the one that is farthest off. An
expectation that names none takes the run's **total** where the metric has one (counts, and rates over pooled
packets), and otherwise every estimator, network or attack window, those where the metric is undefined left
out.

A figure that is undefined for something that was named, or for everything, fails. A figure without bound (the
error of an estimator that diverged, the delay of a detection that never came) is above every bound: it fails
``at_most`` and passes ``at_least``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

Scope = Literal["node", "network", "link", "window", "sender"]


@dataclass(frozen=True)
class Metric:
    """One metric.

    Parameters
    ----------
    meaning
        One line for people.
    scope
        What one value belongs to: an estimator, a network of estimators, a set of links, an attack window, or
        a node with an event trigger.
    total
        Whether an expectation without selector takes one value for the whole run.
    undefined
        Why there may be no value.
    """

    meaning: str
    scope: Scope
    total: bool = False
    undefined: str = "no such step was scored"

    @property
    def selectors(self) -> tuple[str, ...]:
        """What an expectation may name; where the scope is links, a node stands for those that enter it."""
        return ("link", "node") if self.scope in ("link", "window") else ("node",)

    def __str__(self) -> str:
        """Return the meaning."""
        return self.meaning


_NEVER = "nowhere: it is a count"
_NO_RECOVERY = "no attacked packet that an estimate (or a variance) of the attack was published for"
_NO_REFERENCE = "it is the reference, or 'score: {reference: ...}' names none"
_NO_DETECTOR = "no detector judged these links"
_NO_COVARIANCE = "it published no usable covariance"
_NO_PACKET = "no packet was sent"
_NO_PROBABILITY = "it published no attack probability"
_NO_SIGNAL = "no such step, or it published no attack probability"

METRICS: Mapping[str, Metric] = {
    "rmse.*": Metric("root mean square error of a state group over the scored steps", "node"),
    "rmse_attacked.*": Metric("the same, over steps in which an attacked packet reached the node", "node"),
    "rmse_unattacked.*": Metric("the same, over the other steps", "node"),
    "peak.*": Metric("largest error norm of a state group", "node"),
    "final.*": Metric("error norm of a state group at the end, of the last estimate that has one", "node"),
    "nees.mean": Metric("mean NEES; n when consistent", "node", undefined=_NO_COVARIANCE),
    "nees.ratio": Metric(
        "mean NEES over its degrees of freedom; 1 when consistent", "node", undefined=_NO_COVARIANCE
    ),
    "nees.inside": Metric("share of steps whose NEES is within its bounds", "node", undefined=_NO_COVARIANCE),
    "bound.outside": Metric(
        "share of steps whose error is outside e' P^-1 e <= n", "node", undefined=_NO_COVARIANCE
    ),
    "bound.guaranteed": Metric(
        "1 when the method says that its covariance is a guaranteed bound, 0 when it is none",
        "node",
        undefined="the method does not say",
    ),
    "nis.mean": Metric("mean NIS", "node", undefined="it published no NIS"),
    "nis.ratio": Metric(
        "mean NIS over its degrees of freedom; 1 when consistent", "node", undefined="it published no NIS"
    ),
    "nis.inside": Metric(
        "share of steps whose NIS is within its bounds", "node", undefined="it published no NIS"
    ),
    "deviation.component_rms": Metric(
        "RMS of a component of the difference from the reference's estimate", "node", undefined=_NO_REFERENCE
    ),
    "deviation.norm_over_steps": Metric(
        "root of the summed squared difference from the reference's estimate, over the number of steps",
        "node",
        undefined=_NO_REFERENCE,
    ),
    "disagreement": Metric(
        "RMS distance of a network's estimates from their mean",
        "network",
        undefined="no two estimators to compare",
    ),
    "divergences": Metric("estimators that diverged", "node", total=True, undefined=_NEVER),
    "missing_estimates": Metric("steps without an estimate", "node", total=True, undefined=_NEVER),
    "lockouts": Metric(
        "links whose genuine packets a detector rejects for good", "link", total=True, undefined=_NEVER
    ),
    "detector.recall": Metric(
        "share of the attacked packets delivered that were rejected",
        "link",
        total=True,
        undefined="no attacked packet met a detector",
    ),
    "detector.precision": Metric(
        "share of the rejected packets that were attacked",
        "link",
        total=True,
        undefined="no packet was rejected",
    ),
    "detector.false_alarm_rate": Metric(
        "share of the genuine packets delivered that were rejected",
        "link",
        total=True,
        undefined=_NO_DETECTOR,
    ),
    "detector.missed_windows": Metric(
        "attack windows without an alarm", "link", total=True, undefined=_NO_DETECTOR
    ),
    "detector.delay": Metric(
        "steps from a window's first attacked packet to the first alarm",
        "window",
        undefined="no attack met a detector",
    ),
    "detector.release": Metric(
        "steps from the first genuine packet after a window to the first accepted one",
        "window",
        undefined="no attack met a detector",
    ),
    "attack.probability_on": Metric(
        "mean attack probability over steps with a signal attack", "node", undefined=_NO_SIGNAL
    ),
    "attack.probability_off": Metric(
        "mean attack probability over steps without one", "node", undefined=_NO_SIGNAL
    ),
    "attack.false_alarms": Metric(
        "steps without signal attack that it calls attacked", "node", undefined=_NO_PROBABILITY
    ),
    "attack.misses": Metric(
        "steps with a signal attack that it calls free of one", "node", undefined=_NO_PROBABILITY
    ),
    "attack.detection_delay": Metric(
        "steps from the onset of a signal attack to its detection, the longest",
        "node",
        undefined="no signal attack, or it published no attack probability",
    ),
    "attack.release_delay": Metric(
        "steps from the end of a signal attack to the all-clear, the longest",
        "node",
        undefined="no signal attack ended, or it published no attack probability",
    ),
    "attack.rmse": Metric(
        "root mean square error of the estimate of a signal attack, while there is one",
        "node",
        undefined="no signal attack, or it published no estimate of it",
    ),
    "sent_rate": Metric(
        "share of its slots that a node with an event trigger used",
        "sender",
        total=True,
        undefined="there is no event trigger",
    ),
    "recovered.rmse": Metric(
        "root mean square error of the estimate of what an attack adds to a sensor's packets",
        "link",
        total=True,
        undefined=_NO_RECOVERY,
    ),
    "recovered.nees_ratio": Metric(
        "mean squared error of that estimate over its claimed variance; 1 when consistent",
        "link",
        total=True,
        undefined=_NO_RECOVERY,
    ),
    "packets.sent": Metric("packets sent", "link", total=True, undefined=_NEVER),
    "packets.lost": Metric("packets lost", "link", total=True, undefined=_NEVER),
    "packets.attacked": Metric("packets attacked", "link", total=True, undefined=_NEVER),
    "packets.delivered": Metric("packets delivered", "link", total=True, undefined=_NEVER),
    "packets.injected": Metric("packets that nobody sent", "link", total=True, undefined=_NEVER),
    "packets.duplicated": Metric("further copies of packets", "link", total=True, undefined=_NEVER),
    "packets.refused": Metric(
        "packets that failed the receiver's check", "link", total=True, undefined=_NEVER
    ),
    "packets.in_flight": Metric(
        "packets still under way when the run ended", "link", total=True, undefined=_NEVER
    ),
    "packets.lost_share": Metric(
        "share of the packets sent that were lost", "link", total=True, undefined=_NO_PACKET
    ),
    "packets.mean_loss_burst": Metric(
        "mean number of packets lost in a row", "link", total=True, undefined="no packet was lost"
    ),
}
"""Metrics by name; ``.*`` stands for a metric of each state group, ``state`` (all of it) included."""


def find_metric(name: str, groups: Collection[str]) -> Metric | None:
    """Return a metric by its full name, given the plant's state groups; None when there is none."""
    if name.endswith("*"):
        return None
    family, _, group = name.partition(".")
    found = METRICS.get(f"{family}.*")
    if found is not None:
        return found if group == "state" or group in groups else None
    return METRICS.get(name)


def metric_names(groups: Collection[str]) -> list[str]:
    """Return the full names of all metrics, given the plant's state groups."""
    names = []
    for name in METRICS:
        family, _, last = name.rpartition(".")
        names += [f"{family}.{group}" for group in sorted({*groups, "state"})] if last == "*" else [name]
    return names
