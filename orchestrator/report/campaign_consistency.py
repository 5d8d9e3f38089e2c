"""Consistency over many trials: averages of NEES and NIS at each step, with their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np

from orchestrator.evidence.bootstrap import Band
from orchestrator.evidence.consistency import by_step
from orchestrator.evidence.consistency_of_rows import ChiSquare, chi_square_figures
from orchestrator.report.contents import Choice, Figure, Trace, View
from orchestrator.report.group_pieces import band_traces, seen_first
from orchestrator.report.groups import Group
from orchestrator.report.lines import log_axis, step_axis
from orchestrator.score.gather import Floats

NODES = 16
"""Most estimators that can be chosen one by one."""


def consistency_curves(groups: Sequence[Group], notes: list[str]) -> Figure | None:
    """Return NEES and NIS averaged over trials at each step, one estimator at a time, with their bounds."""
    hit = [node for group in groups for node in group.attacked]
    nodes = list(dict.fromkeys([*hit, *(node for group in groups for node in group.nodes)]))
    shown = [node for group in groups for node in group.nodes if node in set(nodes[:NODES])]
    shown = list(dict.fromkeys(shown))
    if len(shown) < len(nodes):
        notes.append(f"ANEES and ANIS over time: {len(shown)} of {len(nodes)} estimators can be chosen.")
    views: dict[tuple[str, ...], View] = {}
    for node in shown:
        for what in get_args(ChiSquare):
            traces = _consistency_traces(groups, node, what)
            values = [trace["y"] for trace in traces]
            axis = log_axis(f"A{what.upper()} by its dof", values) if traces else {}
            views[node, what] = View(traces, {"yaxis": axis})
    if not any(view.traces for view in views.values()):
        return None
    first = next(node for node in [*hit, *shown] if node in shown)
    return Figure(
        name="consistency",
        title="ANEES and ANIS over time",
        views=views,
        layout={"xaxis": step_axis(*(group.period_s for group in groups)), "hovermode": "x unified"},
        choices=(
            Choice("Estimator", [(node, node) for node in shown], first),
            Choice("Figure", [("nees", "ANEES"), ("nis", "ANIS")], "nees"),
        ),
        text="NEES or NIS of one estimator, averaged over trials and divided by its degrees of freedom: 1 is "
        f"consistent. A consistent one stays within its band in {100 * groups[0].confidence:g} % of the "
        "steps; above, it is too sure of itself, below too careful.",
        height=380,
    )


def _consistency_traces(groups: Sequence[Group], node: str, what: ChiSquare) -> list[Trace]:
    traces: list[Trace] = []
    having = [(number, group) for number, group in enumerate(groups) if group.of(node).trial.size]
    looks = seen_first([group.rank for _, group in having])
    for (number, group), look in zip(having, looks, strict=True):
        rows = group.of(node)
        found = by_step(*chi_square_figures(rows, what), confidence=group.confidence)
        if np.isfinite(found.ratio).any():
            own = band_traces(Band(found.ratio, found.low, found.high), group.name, number, **look)
            traces += own[1:] if _drawn_already(own[0]["y"], traces) else own
    return traces


def _drawn_already(outline: Floats, traces: Sequence[Trace]) -> bool:
    """Return whether a band of this outline is there: variants with as many packets share it."""
    return any("fill" in trace and np.array_equal(trace["y"], outline, equal_nan=True) for trace in traces)
