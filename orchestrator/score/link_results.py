"""What a score holds of links: packets, verdicts on them, and the attacks on them.

Plain values, with None where a figure is undefined. Steps are integers of the plan.
"""

from __future__ import annotations

from typing import ClassVar

import msgspec


def _ratio(part: int, whole: int) -> float | None:
    return part / whole if whole else None


class Confusion(msgspec.Struct, frozen=True, kw_only=True):
    """Verdicts on delivered packets: *positive* means attacked, and no verdict is no alarm."""

    true_positive: int
    false_positive: int
    false_negative: int
    true_negative: int
    recall: float | None
    precision: float | None
    false_alarm_rate: float | None

    @classmethod
    def of(
        cls, *, true_positive: int, false_positive: int, false_negative: int, true_negative: int
    ) -> Confusion:
        """Return the confusion of these counts, with its rates."""
        return cls(
            true_positive=true_positive,
            false_positive=false_positive,
            false_negative=false_negative,
            true_negative=true_negative,
            recall=_ratio(true_positive, true_positive + false_negative),
            precision=_ratio(true_positive, true_positive + false_positive),
            false_alarm_rate=_ratio(false_positive, false_positive + true_negative),
        )


class AttackWindow(msgspec.Struct, frozen=True, kw_only=True):
    """One attack stage on one link, from the first to the last step in which its packets were delivered.

    Of its ``packets`` delivered, ``rejected`` raised an alarm. ``delay`` counts steps from ``first`` to the
    first alarm (None: missed, ``censored`` when the run ended first). ``release`` counts steps from the first
    genuine packet after the window to the first that is accepted (None: never).
    """

    link: str
    stage: str
    judged: bool
    first: int
    last: int
    packets: int
    rejected: int
    delay: int | None
    censored: bool
    release: int | None


class Lockout(msgspec.Struct, frozen=True, kw_only=True):
    """A detector that rejected all the last ``packets`` genuine packets of a link, from ``first_step`` on."""

    node: str
    link: str
    first_step: int
    packets: int


class Traffic(msgspec.Struct, frozen=True, kw_only=True):
    """Packets of one link or of all, as the channel counted them.

    ``sent + injected + duplicated = delivered + lost + refused + in_flight``: a refused packet came and
    failed the receiver's check, one in flight had not come when the run ended. ``loss_bursts`` counts runs of
    consecutive packets of a link that were lost; ``mean_loss_burst`` is their mean length.
    """

    COUNTS: ClassVar[tuple[str, ...]] = (
        *("sent", "lost", "attacked", "delivered", "injected", "duplicated", "refused", "in_flight"),
        "loss_bursts",
    )

    sent: int
    lost: int
    attacked: int
    delivered: int
    injected: int
    duplicated: int
    refused: int
    in_flight: int
    loss_bursts: int
    lost_share: float | None
    mean_loss_burst: float | None

    @classmethod
    def of(cls, **counts: int) -> Traffic:
        """Return the traffic of these counts, with its shares."""
        return cls(
            **counts,
            lost_share=_ratio(counts["lost"], counts["sent"]),
            mean_loss_burst=_ratio(counts["lost"], counts["loss_bursts"]),
        )


class SenderScore(msgspec.Struct, frozen=True, kw_only=True):
    """A node with an event trigger: of its ``slots`` it filled, or its method called sent, so many.

    ``rate`` is their share, None where it had no slot.
    """

    name: str
    slots: int
    sent: float
    rate: float | None

    @classmethod
    def of(cls, name: str, slots: int, sent: float) -> SenderScore:
        """Return the account of these counts, with its rate."""
        return cls(name=name, slots=slots, sent=sent, rate=sent / slots if slots else None)


class RecoveredAttack(msgspec.Struct, frozen=True, kw_only=True):
    """An estimator's estimate of what is added to a sensor's packets, over the attacked ones that it used.

    ``rmse`` is the root mean square of the Euclidean norm of its error. ``nees_ratio`` is the mean of the
    squared error over its claimed variance, component by component: 1 when consistent, None when none is
    claimed.
    """

    packets: int
    rmse: float
    nees_ratio: float | None


class LinkScore(msgspec.Struct, frozen=True, kw_only=True):
    """One link. ``detector`` is None when no verdict was ever given on it.

    ``recovered`` is None unless its receiver estimates the attack on it, and there was one.
    """

    name: str
    source: str
    destination: str
    stream: str
    traffic: Traffic
    detector: Confusion | None
    recovered: RecoveredAttack | None = None
