"""Figures of many trials: errors with bands, their spread, outcomes, consistency, communication."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.evidence.bootstrap import Band
from orchestrator.evidence.consistency import by_step
from orchestrator.evidence.figures import disagreement_curve, efficiency, rmse, rmse_curve, sent_rate
from orchestrator.evidence.pareto import pareto_front
from orchestrator.report.contents import Choice, Figure, Trace, View
from orchestrator.report.groups import ALL, ATTACKED, Group, state_names, trial_rmse
from orchestrator.report.lines import band, line, log_axis, step_axis, value_axis
from orchestrator.report.palette import SERIES, SYMBOLS, series_style
from orchestrator.report.thinning import POINTS, kept
from orchestrator.score.gather import Floats

SHOWN = 8
"""Groups that are drawn at first."""

LABEL = 20
"""Most letters of a line of an axis' label."""

NODES = 16
"""Most estimators that can be chosen one by one."""


def _visible(number: int) -> dict[str, Any]:
    return {} if number < SHOWN else {"visible": "legendonly"}


def _band_traces(found: Band, name: str, number: int, **more: Any) -> list[Trace]:
    """Return a curve with its band, in the style of a number; both go by one key of the legend."""
    at = kept(found.value)
    style, look = series_style(number), {**_visible(number), **more}
    colour = style["color"]
    edges = band(at, found.low[at], found.high[at], name, f"{colour}/13", **look)
    middle = line(at, found.value[at], name, colour, dash=style["dash"], hovertemplate="%{y:.4g}", **look)
    for trace in edges:
        trace["showlegend"] = False
    return [*edges, {**middle, "legendgroup": name}]


def scopes(groups: Sequence[Group]) -> list[tuple[str, str]]:
    """Return the choices of estimators: all, and the attacked ones where these are fewer."""
    found = [(ALL, "all estimators")]
    if any(0 < len(group.attacked) < len(group.nodes) for group in groups):
        found.append((ATTACKED, "attacked estimators only"))
    return found


def _initial(choices: Sequence[tuple[str, str]]) -> str:
    return choices[-1][0]


def _state_choice(groups: Sequence[Group]) -> Choice:
    names = state_names(groups)
    return Choice(
        "State group", [(name, "whole state" if name == "state" else name) for name in names], names[0]
    )


def error_curves(groups: Sequence[Group], notes: list[str]) -> Figure:
    """Return RMSE over time with bootstrap bands, by group, and the bound where it is right."""
    choice, scope = _state_choice(groups), scopes(groups)
    if max(group.rows.steps for group in groups) > POINTS:
        notes.append(f"RMSE over time: smallest and largest of each stretch, {POINTS:,} points a line.")
    views: dict[tuple[str, ...], View] = {}
    for state, _ in choice.options:
        for which, _ in scope:
            traces: list[Trace] = []
            for number, group in enumerate(groups):
                rows = group.of(which)
                if rows.trial.size:
                    found = rmse_curve(rows, state, group.confidence)
                    traces += _band_traces(found, group.name, number)
                    traces += _bound_trace(group, state, which, number)
            values = [trace["y"] for trace in traces if trace.get("name") and "fill" not in trace]
            views[state, which] = View(traces, {"yaxis": _error_axis(f"RMSE of {state}", values)})
    return Figure(
        name="rmse",
        title="RMSE over time",
        views=views,
        layout={"xaxis": step_axis(*(group.period_s for group in groups)), "hovermode": "x unified"},
        choices=(choice, Choice("Of", scope, _initial(scope))),
        text=f"Root mean square over trials, with {100 * groups[0].confidence:g} % bootstrap bands: whole "
        "trials are drawn again, for what happens inside one hangs together. Dotted: the posterior "
        "Cramér-Rao bound, as far as it is right.",
        height=420,
    )


def _bound_trace(group: Group, state: str, which: str, number: int) -> list[Trace]:
    """Return the posterior Cramer-Rao bound, where it is right."""
    rows = group.of(which)
    if not np.isfinite(rows.series(f"bound.{state}")).any():
        return []
    found = efficiency(rows, state, group.from_step, group.confidence)
    at = kept(found.bound.value)
    style = {"width": 1.2, "dash": "dot", "hovertemplate": "bound %{y:.4g}", **_visible(number)}
    colour = f"${SERIES[number % len(SERIES)]}"
    look = {"legendgroup": group.name, "showlegend": False}
    return [line(at, found.bound.value[at], f"bound, {group.name}", colour, **style, **look)]


def _error_axis(title: str, values: Sequence[Floats]) -> dict[str, Any]:
    known = np.concatenate([v[np.isfinite(v) & (v > 0)] for v in values] or [np.zeros(0)])
    if known.size and known.max() > 50.0 * np.median(known):
        return log_axis(title, [known])
    return value_axis(title, rangemode="tozero")


def trial_spread(groups: Sequence[Group]) -> Figure:
    """Return the RMSE of every trial as boxes with their points."""
    choice, scope = _state_choice(groups), scopes(groups)
    views: dict[tuple[str, ...], View] = {}
    for state, _ in choice.options:
        for which, _ in scope:
            traces = []
            for number, group in enumerate(groups):
                values = trial_rmse(group.of(which), state)
                finite = values[np.isfinite(values)]
                traces.append(_box(group, number, finite))
            axis = _error_axis(f"RMSE of {state}", [trace["x"] for trace in traces])
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
        choices=(choice, Choice("Of", scope, _initial(scope))),
        text="A point is a trial; the box holds the middle half, its line is the median. Trials that "
        "diverged have no finite error: they are counted in the table, not drawn.",
        height=_height(groups, 54),
    )


def label(group: Group) -> str:
    """Return a name for an axis, broken into short lines at commas and underscores."""
    lines = [""]
    for part in re.findall(r"[^,_]+[,_]?", group.name):
        if lines[-1] and len(lines[-1]) + len(part) > LABEL:
            lines.append("")
        lines[-1] += part
    return "<br>".join(own.strip() for own in lines)


def _height(groups: Sequence[Group], row: int) -> int:
    """Return the height (pixels) of a figure with a row a group, tall enough for the rows' labels."""
    lines = max(label(group).count("<br>") + 1 for group in groups)
    return max(100 + len(groups) * max(row, 16 * lines + 10), 180)


def _box(group: Group, number: int, values: Floats) -> Trace:
    colour = f"${SERIES[number % len(SERIES)]}"
    thinned = values[kept(np.sort(values), POINTS)] if values.size > POINTS else values
    return {
        "type": "box",
        "orientation": "h",
        "x": thinned,
        "y": [label(group)] * thinned.size,
        "name": group.name,
        "line": {"color": colour, "width": 1.5},
        "fillcolor": f"{colour}/20",
        "boxpoints": "all",
        "jitter": 0.5,
        "pointpos": 0,
        "marker": {"color": colour, "size": 4, "opacity": 0.6},
        "hovertemplate": "%{x:.4g}<extra></extra>",
        "showlegend": False,
    }


def outcome_figure(groups: Sequence[Group]) -> Figure:
    """Return which share of the trials of each group passed, fell short, diverged or failed."""
    kinds = ("passed", "expectation failed", "diverged", "no score")
    colours = ("$green", "$amber", "$attack", "$slate")
    shares = np.zeros((len(kinds), len(groups)))
    for column, group in enumerate(groups):
        passed, diverged, failed = group.passed, group.diverged & ~group.passed, group.rows.failed
        short = ~(passed | diverged | failed)
        shares[:, column] = [part.mean() for part in (passed, short, diverged, failed)]
    labels = [label(group) for group in groups]
    traces = [
        {
            "type": "bar",
            "orientation": "h",
            "x": shares[row],
            "y": labels,
            "name": kind,
            "marker": {"color": colours[row], "line": {"width": 0}},
            "hovertemplate": f"{kind}: %{{x:.1%}}<extra></extra>",
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
        "diverged unless it passed all the same.",
        height=_height(groups, 40),
    )


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
        for what in ("nees", "nis"):
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


def _consistency_traces(groups: Sequence[Group], node: str, what: str) -> list[Trace]:
    traces: list[Trace] = []
    for number, group in enumerate(groups):
        rows = group.of(node)
        if not rows.trial.size:
            continue
        figures = rows.series(what)
        if what == "nees":
            size = np.broadcast_to(rows.scalar("state_size").astype(np.int64)[:, None], figures.shape)
            dof = np.where(np.isfinite(figures), size, 0)
        else:
            dof = np.nan_to_num(rows.series("nis_dof")).astype(np.int64)
        found = by_step(figures, dof, confidence=group.confidence)
        if np.isfinite(found.ratio).any():
            own = _band_traces(Band(found.ratio, found.low, found.high), group.name, number)
            traces += own[2:] if _drawn_already(own[1]["y"], traces) else own
    return traces


def _drawn_already(high: Floats, traces: Sequence[Trace]) -> bool:
    """Return whether a band of the same upper edge is there: variants with as many packets share it."""
    return any("fill" in trace and np.array_equal(trace["y"], high, equal_nan=True) for trace in traces)


def pareto_figure(groups: Sequence[Group]) -> Figure | None:
    """Return errors against how often nodes speak, with the front that nobody beats in both."""
    choice, scope = _state_choice(groups), scopes(groups)
    views: dict[tuple[str, ...], View] = {}
    rates = {which: [sent_rate(group.of(which)) for group in groups] for which, _ in scope}
    known = [rate.value for rate in rates[ALL] if np.isfinite(rate.value)]
    if len(known) < 2:
        return None
    for state, _ in choice.options:
        for which, _ in scope:
            errors = [rmse(group.of(which), state, group.confidence) for group in groups]
            axis = _error_axis(f"RMSE of {state}", [np.array([error.value for error in errors])])
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
        choices=(choice, Choice("Of", scope, _initial(scope))),
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
    """Return how far the estimators of a network are apart over time, with bands."""
    traces: list[Trace] = []
    for number, group in enumerate(groups):
        found = disagreement_curve(group.rows, group.confidence)
        if np.isfinite(found.value).any():
            traces += _band_traces(found, group.name, number)
    if not traces:
        return None
    return Figure(
        name="disagreement",
        title="Disagreement over time",
        views={(): View(traces)},
        layout={
            "xaxis": step_axis(*(group.period_s for group in groups)),
            "yaxis": _error_axis("disagreement", [trace["y"] for trace in traces]),
            "hovermode": "x unified",
        },
        text="RMS distance of the estimates of one network from their mean, over trials.",
        height=300,
    )
