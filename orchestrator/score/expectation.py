"""What a topology expects of its run: bounds on the score's metrics."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Expectation:
    """Bounds on one metric of `orchestrator.score.catalogue`.

    Parameters
    ----------
    metric
        Full name, such as ``rmse.position``.
    nodes, links
        For each of which it must hold; none means the whole run.
    at_most, at_least, equals
        The bounds, in the metric's unit; None where not given.
    line
        Where the topology file states it; None for a topology that comes from a log.
    """

    metric: str
    nodes: tuple[str, ...] = ()
    links: tuple[str, ...] = ()
    at_most: float | None = None
    at_least: float | None = None
    equals: float | None = None
    line: int | None = None
