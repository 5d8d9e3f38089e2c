"""Consistency over many trials: averages of NEES and NIS, with their bounds and verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np

from orchestrator.evidence.bootstrap import Band
from orchestrator.evidence.consistency import Overall, by_step
from orchestrator.evidence.consistency_of_rows import (
    ChiSquare,
    Consistency,
    LeastWhite,
    chi_square_figures,
    consistency,
)
from orchestrator.report.campaign_tables import figure
from orchestrator.report.contents import Choice, Figure, Mark, Table, Trace, View
from orchestrator.report.group_pieces import band_traces, seen_first
from orchestrator.report.groups import Group
from orchestrator.report.lines import log_axis, step_axis
from orchestrator.score.gather import Floats

NODES = 16
"""Most estimators that can be chosen one by one."""

_TONES = {"consistent": "good", "overconfident": "bad", "conservative": "warn", "unknown": "plain"}
_PLAIN_TRIGGERS = ("periodic",)
"""Event triggers whose silence tells nothing of the measurement."""


def consistency_table(groups: Sequence[Group]) -> Table:
    """Return NEES and NIS of each group over all steps, with their verdicts."""
    rows = []
    for group in groups:
        found = consistency(group.rows, group.from_step, group.confidence)
        for what, split in (("NEES", found.nees), ("NIS", found.nis)):
            own = split.all
            if np.isnan(own.ratio):
                continue
            bounds = "-" if np.isnan(own.low) else f"{own.low:.4g} to {own.high:.4g}"
            rows.append(
                (
                    group.name,
                    what,
                    figure(own.ratio),
                    bounds,
                    _verdict(own, found, what, group),
                    figure(split.attacked.ratio),
                    figure(split.unattacked.ratio),
                    _white(found.whiteness.all, group) if what == "NIS" else "-",
                )
            )
    columns = ("variant", "figure", "by its dof", "if consistent", "verdict", "under attack", "else", "white")
    return Table("Consistency over all steps", columns, rows, frozenset({0, 1}))


def _verdict(own: Overall, found: Consistency, what: str, group: Group) -> Mark:
    """Return a judgement, withheld where what is left out could only have made it worse."""
    missing = []
    if what == "NIS" and _hears_surprises(group):
        return Mark("not judged: sent because it surprises", _TONES["unknown"])
    if what == "NEES" and found.undefined:
        missing.append(f"{100 * found.undefined:.3g} % of the covariances are none")
    if found.diverged:
        missing.append(f"{found.diverged:,} of {found.trials:,} trials diverged")
    if not missing or own.judgement == "overconfident":
        return Mark(own.judgement, _TONES[own.judgement])
    return Mark(f"unknown: {', '.join(missing)}", _TONES["unknown"])


def _white(least: LeastWhite, group: Group) -> str:
    found = least.found
    if np.isnan(found.p_value) or _hears_surprises(group):
        return "-"
    shown = "p < 0.001" if found.p_value < 0.001 else f"p {found.p_value:.2g}"
    node = f"{least.node}: " if len(group.nodes) > 1 else ""
    by = ", by NIS" if least.from_nis else ""
    return f"{'yes' if found.is_white(group.confidence) else 'no'} ({node}{shown}{by})"


def _hears_surprises(group: Group) -> bool:
    """Return whether a sensor that is heard decides by its measurement whether to speak.

    What it sends is then no draw from the law of innovations, even where the filter is optimal.
    """
    estimators, sensors = group.document["estimators"], group.document["sensors"]
    heard = {name for node in group.nodes for name in estimators[node].get("sensors", ())}
    triggers = [kind for name in heard for kind in sensors[name].get("send") or ()]
    return any(kind not in _PLAIN_TRIGGERS for kind in triggers)


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
            axis = log_axis(f"A{what.upper()} by its dof", values, np.ones(1)) if traces else {}
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
