"""Errors over many trials: RMSE with bands, its spread, and what became of the trials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.evidence.figures import efficiency, rmse_curve
from orchestrator.report.contents import Choice, Figure, Trace, View
from orchestrator.report.group_pieces import (
    band_traces,
    error_axis,
    first_scope,
    height,
    labels,
    scopes,
    seen_first,
    state_choice,
    told_of_labels,
)
from orchestrator.report.groups import Group, judged_by_expectations, trial_rmse
from orchestrator.report.lines import line, step_axis
from orchestrator.report.palette import SERIES
from orchestrator.report.thinning import POINTS, kept
from orchestrator.score.gather import Floats


def error_curves(groups: Sequence[Group], notes: list[str]) -> Figure:
    """Return RMSE over time with bootstrap bands, by group, and the bound where it is right."""
    choice, scope = state_choice(groups), scopes(groups)
    if max(group.rows.steps for group in groups) > POINTS:
        notes.append(f"RMSE over time: smallest and largest of each stretch, {POINTS:,} points a line.")
    views: dict[tuple[str, ...], View] = {}
    for state, _ in choice.options:
        for which, _ in scope:
            traces: list[Trace] = []
            looks = seen_first([group.rank for group in groups])
            for number, (group, look) in enumerate(zip(groups, looks, strict=True)):
                rows = group.of(which)
                if rows.trial.size:
                    found = rmse_curve(rows, state, group.confidence)
                    traces += band_traces(found, group.name, number, **look)
                    traces += _bound_trace(group, state, which, number, look)
            values = [trace["y"] for trace in traces if trace.get("name") and "fill" not in trace]
            views[state, which] = View(traces, {"yaxis": error_axis(f"RMSE of {state}", values)})
    return Figure(
        name="rmse",
        title="RMSE over time",
        views=views,
        layout={"xaxis": step_axis(*(group.period_s for group in groups)), "hovermode": "x unified"},
        choices=(choice, Choice("Of", scope, first_scope(groups))),
        text=f"Root mean square over trials, with {100 * groups[0].confidence:g} % bootstrap bands: whole "
        "trials are drawn again, for what happens inside one hangs together. Dotted: the posterior "
        "Cramér-Rao bound, as far as it is right.",
        height=420,
    )


def _bound_trace(group: Group, state: str, which: str, number: int, look: dict[str, Any]) -> list[Trace]:
    """Return the posterior Cramer-Rao bound, where it is right."""
    rows = group.of(which)
    if not np.isfinite(rows.series(f"pcrb.{state}")).any():
        return []
    found = efficiency(rows, state, group.from_step, group.confidence)
    at = kept(found.bound.value)
    style = {"width": 1.2, "dash": "dot", "hovertemplate": "bound %{y:.4g}", **look}
    colour = f"${SERIES[number % len(SERIES)]}"
    key = {"legendgroup": group.name, "showlegend": False}
    return [line(at, found.bound.value[at], f"bound, {group.name}", colour, **style, **key)]


def trial_spread(groups: Sequence[Group]) -> Figure:
    """Return the RMSE of every trial as boxes with their points."""
    choice, scope = state_choice(groups), scopes(groups)
    views: dict[tuple[str, ...], View] = {}
    for state, _ in choice.options:
        for which, _ in scope:
            traces = []
            for number, (group, label) in enumerate(zip(groups, labels(groups), strict=True)):
                values = trial_rmse(group.of(which), state)
                finite = values[np.isfinite(values)]
                traces.append(_box(group, label, number, finite))
            axis = error_axis(f"RMSE of {state}", [trace["x"] for trace in traces])
            views[state, which] = View(traces, {"xaxis": axis})
    return Figure(
        name="trials",
        title="RMSE of each trial",
        views=views,
        layout={
            "yaxis": {
                "type": "category",
                "autorange": "reversed",
                "showgrid": False,
                "tickfont": {"size": 12},
            },
            "boxmode": "overlay",
            "margin": {"l": 30, "r": 14, "t": 10, "b": 44},
        },
        choices=(choice, Choice("Of", scope, first_scope(groups))),
        text="A point is a trial; the box holds the middle half, its line is the median. Trials that "
        "diverged have no finite error: they are counted in the table, not drawn." + told_of_labels(groups),
        height=height(groups, 54),
    )


def _box(group: Group, label: str, number: int, values: Floats) -> Trace:
    colour = f"${SERIES[number % len(SERIES)]}"
    thinned = values[kept(np.sort(values), POINTS)] if values.size > POINTS else values
    return {
        "type": "box",
        "orientation": "h",
        "x": thinned,
        "y": [label] * thinned.size,
        "name": group.name,
        "line": {"color": colour, "width": 1.5},
        "fillcolor": f"{colour}/20",
        "boxpoints": "all",
        "jitter": 0.5,
        "pointpos": 0,
        "marker": {"color": colour, "size": 4, "opacity": 0.6},
        "hovertemplate": f"{group.name}<br>%{{x:.4g}}<extra></extra>",
        "showlegend": False,
    }


def outcome_figure(groups: Sequence[Group]) -> Figure:
    """Return which share of the trials of each group passed, fell short, diverged or failed.

    Unattacked twins are left out where others are there: what is expected of an attack they cannot fulfil.
    """
    groups = judged_by_expectations(groups) or groups
    kinds = ("passed", "expectation failed", "diverged", "no score")
    colours = ("$green", "$amber", "$attack", "$slate")
    shares = np.zeros((len(kinds), len(groups)))
    for column, group in enumerate(groups):
        passed, diverged, failed = group.passed, group.diverged & ~group.passed, group.rows.failed
        short = ~(passed | diverged | failed)
        shares[:, column] = [part.mean() for part in (passed, short, diverged, failed)]
    traces = [
        {
            "type": "bar",
            "orientation": "h",
            "x": shares[row],
            "y": labels(groups),
            "customdata": [group.name for group in groups],
            "name": kind,
            "marker": {"color": colours[row], "line": {"width": 0}},
            "hovertemplate": f"%{{customdata}}<br>{kind}: %{{x:.1%}}<extra></extra>",
        }
        for row, kind in enumerate(kinds)
        if shares[row].any()
    ]
    return Figure(
        name="outcomes",
        title="What became of the trials",
        views={(): View(traces)},
        layout={
            "barmode": "stack",
            "bargap": 0.35,
            "xaxis": {"range": [0, 1], "tickformat": ".0%", "title": {"text": "share of trials"}},
            "yaxis": {"type": "category", "autorange": "reversed", "showgrid": False},
            "margin": {"l": 30, "r": 28, "t": 10, "b": 44},
        },
        text="A trial passes when all that its topology expects holds; one that diverged is shown as "
        "diverged unless it passed all the same." + told_of_labels(groups),
        height=height(groups, 40),
    )
