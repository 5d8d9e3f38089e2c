"""Communication over many trials: what it buys, and how far a network is apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.evidence.bootstrap import Band
from orchestrator.evidence.figures import disagreement_curve, rmse, sent_rate
from orchestrator.evidence.pareto import pareto_front
from orchestrator.report.contents import Choice, Figure, Trace, View
from orchestrator.report.group_pieces import (
    band_traces,
    error_axis,
    first_scope,
    scopes,
    state_choice,
)
from orchestrator.report.groups import ALL, Group
from orchestrator.report.lines import line, step_axis
from orchestrator.report.palette import SERIES, SYMBOLS

LEAST_APART = 1e-3
"""The smallest difference between shares of slots that is drawn."""


def pareto_figure(groups: Sequence[Group]) -> Figure | None:
    """Return errors against how often nodes speak, with the front that nobody beats in both.

    None where all speak as often: then there is nothing to choose between.
    """
    choice, scope = state_choice(groups), scopes(groups)
    views: dict[tuple[str, ...], View] = {}
    rates = {which: [sent_rate(group.of(which), group.confidence) for group in groups] for which, _ in scope}
    known = [rate.value for rate in rates[ALL] if np.isfinite(rate.value)]
    if len(known) < 2 or np.ptp(known) < LEAST_APART:
        return None
    for state, _ in choice.options:
        for which, _ in scope:
            errors = [rmse(group.of(which), state, group.confidence) for group in groups]
            axis = error_axis(f"RMSE of {state}", [np.array([error.value for error in errors])])
            views[state, which] = View(_pareto_traces(groups, rates[which], errors), {"yaxis": axis})
    return Figure(
        name="pareto",
        title="Communication against error",
        views=views,
        layout={
            "xaxis": {
                "title": {"text": "slots with a packet"},
                "tickformat": ".0%",
                "range": [0.0, 1.06],
                "zeroline": False,
            },
        },
        choices=(choice, Choice("Of", scope, first_scope(groups))),
        text="Left and low is better. The line joins those that nobody beats in both at once; bars are "
        "bootstrap intervals over trials.",
        height=380,
    )


def _pareto_traces(groups: Sequence[Group], rates: Sequence[Any], errors: Sequence[Any]) -> list[Trace]:
    cost, value = (np.array([part.value for part in parts]) for parts in (rates, errors))
    front = np.flatnonzero(pareto_front(cost, value))
    front = front[np.argsort(cost[front], kind="stable")]
    edge = line(cost[front], value[front], "front", "$muted", width=1.4, dash="dot", hoverinfo="skip")
    traces: list[Trace] = [edge] if front.size > 1 else []
    for number, group in enumerate(groups):
        error = errors[number]
        colour = f"${SERIES[number % len(SERIES)]}"
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": [rates[number].value],
                "y": [error.value],
                "error_y": {
                    "type": "data",
                    "symmetric": False,
                    "array": [_or_zero(error.high - error.value)],
                    "arrayminus": [_or_zero(error.value - error.low)],
                    "color": colour,
                    "thickness": 1.4,
                },
                "name": group.name,
                "marker": {
                    "size": 11,
                    "color": colour,
                    "symbol": SYMBOLS[number // len(SERIES) % len(SYMBOLS)],
                },
                "hovertemplate": f"{group.name}<br>%{{x:.1%}} of the slots, RMSE %{{y:.4g}}<extra></extra>",
            }
        )
    return traces


def _or_zero(value: float) -> float:
    return float(value) if np.isfinite(value) else 0.0


def disagreement_figure(groups: Sequence[Group]) -> Figure | None:
    """Return how far estimators that belong together are apart over time, with bands."""
    drawn: dict[tuple[tuple[int, int], bytes], tuple[Band, list[Group]]] = {}
    for group in groups:
        found = disagreement_curve(group.rows, group.confidence)
        if np.isfinite(found.value).any():
            _, own = drawn.setdefault((group.variant, found.value.tobytes()), (found, []))
            own.append(group)
    traces: list[Trace] = []
    for number, (found, own) in enumerate(drawn.values()):
        traces += band_traces(found, _apart(own), number)
    if not traces:
        return None
    return Figure(
        name="disagreement",
        title="Disagreement over time",
        views={(): View(traces)},
        layout={
            "xaxis": step_axis(*(group.period_s for group in groups)),
            "yaxis": error_axis("disagreement", [trace["y"] for trace in traces]),
            "hovermode": "x unified",
        },
        text="RMS distance from their mean of the estimates of one network, or of estimators of one method "
        "that are each alone; over trials.",
        height=300,
    )


def _apart(groups: Sequence[Group]) -> str:
    """Return a name for groups that are apart from one another by one curve."""
    names = " and ".join(group.name for group in groups)
    if not groups[0].is_apart:
        return names
    return f"{names}, each alone" if sum(len(group.nodes) for group in groups) > 1 else f"{names}, alone"
