"""The figures of a run that are to be seen first."""

from __future__ import annotations

from orchestrator.report.contents import Tile
from orchestrator.score.headline import begun_steps
from orchestrator.score.results import Score

MANY_FALSE_ALARMS = 0.05
"""The share of genuine packets rejected from above which on a detector is warned of."""


def _percent(share: float | None) -> str:
    """Return a share for people."""
    return "-" if share is None else f"{100 * share:.3g} %"


def run_tiles(score: Score) -> list[Tile]:
    """Return the figures of a run that are to be seen first."""
    packets = score.traffic
    diverged = sum(node.divergence_step is not None for node in score.nodes)
    held = sum(outcome.passed for outcome in score.expectations)
    return [
        *_missing(score),
        Tile(
            "Expectations held",
            f"{held} of {len(score.expectations)}" if score.expectations else "none",
            tone="bad" if held < len(score.expectations) else "plain",
        ),
        Tile("Estimators diverged", f"{diverged} of {len(score.nodes)}", tone="bad" if diverged else "plain"),
        Tile("Packets lost", _percent(packets.lost_share), f"{packets.lost:,} of {packets.sent:,}"),
        *_attack_tiles(score),
        *_detector_tiles(score),
    ]


def _attack_tiles(score: Score) -> list[Tile]:
    """Return how many packets were falsified and how many made up, with the links that had some."""
    shown = ("attacked", "injected") if score.traffic.attacked else ("injected",)
    tiles = []
    for what in shown if score.traffic.injected else ("attacked",):
        links = sum(getattr(link.traffic, what) > 0 for link in score.links)
        remark = f"on {links} of {len(score.links)} links" if links else ""
        tiles.append(Tile(f"Packets {what}", f"{getattr(score.traffic, what):,}", remark))
    return tiles


def _detector_tiles(score: Score) -> list[Tile]:
    judged = score.detector
    if judged is None:
        return [Tile("Detector", "none", "no verdict on any packet")]
    attacked = judged.true_positive + judged.false_negative
    genuine = judged.false_positive + judged.true_negative
    often = judged.false_alarm_rate is not None and judged.false_alarm_rate > MANY_FALSE_ALARMS
    tiles = [
        Tile(
            "Attacked packets rejected", _percent(judged.recall), f"{judged.true_positive:,} of {attacked:,}"
        ),
        Tile(
            "Genuine packets rejected",
            _percent(judged.false_alarm_rate),
            f"{judged.false_positive:,} of {genuine:,}",
            tone="warn" if often else "plain",
        ),
    ]
    if score.lockouts:
        deaf = {lockout.node for lockout in score.lockouts}
        remark = f"for good, in {len(deaf)} of {len(score.nodes)} estimators"
        tiles.append(Tile("Links locked out", f"{len(score.lockouts)}", remark, tone="warn"))
    return tiles


def _missing(score: Score) -> list[Tile]:
    """Return how much of the run is there, where that is not all of it."""
    if score.complete:
        return []
    part = begun_steps(score) - score.steps_recorded
    remark = f"whole; {part:,} in part" if part > 0 else f"{score.steps - score.steps_recorded:,} missing"
    return [Tile("Steps recorded", f"{score.steps_recorded:,} of {score.steps:,}", remark, tone="warn")]
