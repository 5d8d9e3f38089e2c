"""Truth against estimates, and how far they are apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.report.contents import Choice, Figure, Trace, View
from orchestrator.report.lines import (
    attack_key,
    band,
    line,
    log_axis,
    stacked,
    value_axis,
)
from orchestrator.report.palette import series_style
from orchestrator.report.recording import Recording
from orchestrator.report.steps import over_steps, step_shapes
from orchestrator.report.thinning import in_order, kept, leading_nodes, points
from orchestrator.score.accuracy import root_mean_square
from orchestrator.score.gather import Bools, Floats

PAIRS = 240
"""Most pairs of node and component that the tracking figure holds."""

BAND_REACH = 4.0
"""How many times the span of its lines a band may reach beyond them before it is cut."""

WIDEST = 30.0
"""How many times the span of its lines a band may usually have before it is cut."""

LINES = 24
"""Most estimators that have a line of their own in the figure of errors."""

FAR, APART = 50.0, 20.0
"""From which ratios on errors are drawn on a logarithmic axis: see `error_axis`."""

SHOWN = 6
"""Estimators whose lines are shown at first."""


def _tracking_traces(recording: Recording, node: int, component: int, most: int) -> list[Trace]:
    """Return the traces of one estimator and component: the values above, the error below."""
    truth, state = recording.truth[:, component], recording.state[node, :, component]
    sigma = recording.sigma[node, :, component]
    chosen = kept(state - truth, most)
    x, reach = chosen, 2.0 * sigma[chosen]
    low, high = state[chosen] - reach, state[chosen] + reach
    hover = "%{y:.4g}"
    below = {"yaxis": "y2", "showlegend": False}
    error = line(x, (state - truth)[chosen], "estimate", "$blue", hovertemplate="error %{y:.4g}", **below)
    return [
        band(x, low, high, "estimate ± 2σ", "$blue/22"),
        line(x, truth[chosen], "truth", "$ink", width=2.2, hovertemplate=hover),
        line(x, state[chosen], "estimate", "$blue", hovertemplate=hover),
        band(x, -reach, reach, "estimate ± 2σ", "$blue/22", **below),
        {**error, "legendgroup": "estimate"},
    ]


def lines_range(traces: Sequence[Trace]) -> dict[str, Any]:
    """Return the range of an axis where a band is so wide that the lines in it could not be told apart."""
    lines = [trace["y"] for trace in traces if trace["line"]["width"]]
    known = np.concatenate([values[np.isfinite(values)] for values in lines])
    edges = np.concatenate([trace["y"] for trace in traces if not trace["line"]["width"]])
    if not known.size or not np.isfinite(edges).any():
        return {}
    low, high = float(known.min()), float(known.max())
    width = 2.0 * float(np.nanmedian(np.abs(edges - np.nanmedian(edges))))
    span = max(high - low, min(width, WIDEST * (high - low)), 1e-9)
    if np.nanmax(edges) <= high + BAND_REACH * span and np.nanmin(edges) >= low - BAND_REACH * span:
        return {}
    return {"range": [low - 0.5 * span, high + 0.5 * span], "autorange": False}


def tracking_figure(recording: Recording, notes: list[str]) -> Figure:
    """Return truth and estimates with 2-sigma bands, one estimator and component at a time."""
    components, names = recording.components, recording.names
    most_nodes = max(PAIRS // max(len(components), 1), 1)
    leading = leading_nodes(recording.score, most_nodes)
    chosen = in_order(leading, names)
    most = points(len(chosen) * len(components))
    if len(chosen) < len(names):
        notes.append(
            f"Truth against estimates: {len(chosen)} of {len(names)} estimators can be chosen, the attacked, "
            "the worst and the best first."
        )
    if recording.steps > most:
        notes.append(
            f"Truth against estimates: of {recording.steps:,} steps about {most:,} a line are drawn, "
            "the smallest and the largest error of each stretch among them."
        )
    views: dict[tuple[str, ...], View] = {}
    for name in chosen:
        node = names.index(name)
        shapes = step_shapes(recording, recording.attacked[node])
        key = [attack_key()] if recording.attacked.any() else []
        for component, label in enumerate(components):
            traces = _tracking_traces(recording, node, component, most)
            above, below = (
                lines_range([trace for trace in traces if trace.get("yaxis", "y") == axis])
                for axis in ("y", "y2")
            )
            axes = {"yaxis": {"title": {"text": label}, **above}, "yaxis2": below}
            views[name, str(component)] = View([*traces, *key], {"shapes": shapes, **axes})
    marks = {node.name: " (attacked)" if node.attacked_steps else "" for node in recording.score.nodes}
    return Figure(
        name="tracking",
        title="Truth and estimate, and the error of it",
        views=views,
        layout=over_steps(recording, stacked(["value", "error"], [0.6, 0.4], recording.plan.period_s)),
        choices=(
            Choice("Estimator", [(name, f"{name}{marks[name]}") for name in chosen], leading[0]),
            Choice("Component", [(str(i), label) for i, label in enumerate(components)], "0"),
        ),
        text="The band is what the estimator itself believes: two standard deviations around its "
        "estimate. An honest one holds the truth in about 95 % of the steps. Shaded: an attacked "
        "packet reached this estimator, or an attack the plant.",
        height=470,
    )


def error_figure(recording: Recording, notes: list[str]) -> Figure:
    """Return the error norms of all estimators over time, by state group."""
    names, groups = recording.names, list(recording.norm)
    leading = leading_nodes(recording.score, LINES)
    drawn = in_order(leading, names)
    if len(drawn) < len(names):
        notes.append(f"Errors over time: lines of {len(drawn)} of {len(names)} estimators.")
    most = points(len(drawn) * len(groups))
    if recording.steps > most:
        notes.append(f"Errors over time: smallest and largest of each stretch, {most:,} points a line.")
    views: dict[tuple[str, ...], View] = {}
    for group in groups:
        norm = recording.norm[group]
        traces = []
        for name in drawn:
            values = norm[names.index(name)]
            at = kept(values, most)
            rank = leading.index(name)
            style = series_style(rank)
            trace = line(at, values[at], name, style["color"], dash=style["dash"], width=1.5)
            traces.append(
                {
                    **trace,
                    "hovertemplate": "%{y:.4g}",
                    "visible": True if rank < SHOWN else "legendonly",
                }
            )
        if len(names) > 1:
            whole = _of_all(norm, recording.alive)
            at = kept(whole, most)
            traces.append(
                line(at, whole[at], "RMS of all", "$ink", width=2.8, dash="solid", hovertemplate="%{y:.4g}")
            )
        key = [attack_key()] if recording.attacked.any() else []
        views[(group,)] = View(
            [*traces, *key],
            {
                "yaxis": error_axis(group, norm, recording.alive),
                "shapes": step_shapes(recording, np.any(recording.attacked, axis=0)),
            },
        )
    choices = [(group, "whole state" if group == "state" else group) for group in groups]
    return Figure(
        name="errors",
        title="Error norm over time",
        views=views,
        layout=over_steps(recording, {"hovermode": "x unified"}),
        choices=(Choice("State group", choices, groups[0]),),
        text="Euclidean distance between estimate and truth in a group of the state's components, at the "
        "step that the estimate is of: a prediction stands a step later than it was made. Shaded: an attack "
        "on any of the estimators, or on the plant. The names below switch lines on and off.",
        height=400,
    )


def error_axis(group: str, norm: Floats, alive: Bools) -> dict[str, object]:
    """Return the axis of errors (N, K): logarithmic where on a linear one some would lie on the floor.

    So it is where an error exceeds the median `FAR` times, or one estimator's median that of another
    `APART` times. What was before divergence is always in sight.
    """
    positive = np.isfinite(norm) & (norm > 0)
    known = norm[positive]
    usual = norm[positive & alive] if (positive & alive).any() else known
    label = f"error of {'the state' if group == 'state' else group}"
    middles = [float(np.median(own[keep])) for own, keep in zip(norm, positive, strict=True) if keep.any()]
    if known.size and (known.max() > FAR * np.median(usual) or max(middles) > APART * min(middles)):
        return log_axis(label, [known], anchor=usual)
    return value_axis(label, rangemode="tozero")


def _of_all(norm: Floats, alive: Bools) -> Floats:
    """Return the RMS over estimators (N, K), from the first step on of which all have spoken that ever do."""
    spoke = ~np.isnan(norm)
    first = np.argmax(spoke, axis=1)[spoke.any(axis=1)]
    whole = root_mean_square(norm, alive, axis=0)
    return np.where(np.arange(whole.size) >= np.max(first, initial=0), whole, np.nan)


def _disagreement(recording: Recording, members: Sequence[int]) -> Floats:
    """Return the RMS distance (K,) from their mean of the estimates of each step, of those not diverged."""
    state = np.where(recording.alive[members][:, :, None], recording.state[members], np.nan)
    known = (~np.isnan(state).any(axis=2)).sum(axis=0)
    count = np.maximum(known, 1)
    with np.errstate(over="ignore"):
        mean = np.nansum(state, axis=0) / count[:, None]
        apart = np.sqrt(np.nansum(np.square(state - mean), axis=(0, 2)) / count)
    return np.where(known >= 2, apart, np.nan)


def disagreement_figure(recording: Recording) -> Figure | None:
    """Return how far estimators that belong together are apart over time; None where there are none."""
    traces = []
    for number, network in enumerate(recording.score.networks):
        values = _disagreement(recording, [recording.names.index(name) for name in network.members])
        if np.isfinite(values).any():
            at = kept(values)
            style = series_style(number)
            alone = "" if recording.score.exchanging.issuperset(network.members) else ", each alone"
            name = f"{network.members[0]} to {network.members[-1]}{alone}"
            traces.append(
                line(at, values[at], name, style["color"], dash=style["dash"], hovertemplate="%{y:.4g}")
            )
    if not traces:
        return None
    axis = value_axis("disagreement", rangemode="tozero")
    if max(np.nanmax(trace["y"]) for trace in traces) > 1e3:
        axis = log_axis("disagreement", [trace["y"] for trace in traces])
    return Figure(
        name="disagreement",
        title="Disagreement over time",
        views={(): View(traces, {"shapes": step_shapes(recording, np.any(recording.attacked, axis=0))})},
        layout=over_steps(recording, {"yaxis": axis, "hovermode": "x unified"}),
        text=f"RMS distance from their mean of the estimates of {_belonging(recording)}.",
        height=260,
    )


def _belonging(recording: Recording) -> str:
    """Return which estimators belong together."""
    exchanging = recording.score.exchanging
    if not exchanging:
        return "the estimators of one method, each of them alone"
    is_network = len(exchanging) == len(recording.names)
    return (
        "each network" if is_network else "each network, or of estimators of one method that are each alone"
    )
