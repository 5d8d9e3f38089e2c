"""Whether the estimators' covariances tell the truth: NEES and NIS with their chi-square bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.report.contents import Choice, Figure, Layout, Trace, View
from orchestrator.report.lines import attack_key, band, line, log_axis, stacked
from orchestrator.report.recording import Recording
from orchestrator.report.steps import over_steps, step_shapes
from orchestrator.report.thinning import in_order, kept, leading_nodes, points
from orchestrator.score.consistency import chi_square_bounds
from orchestrator.score.gather import Floats, Ints
from orchestrator.score.results import Consistency, NodeScore

MOST_NODES = 60


def _bounded(
    values: Floats, dof: Ints, confidence: float, name: str, most: int
) -> tuple[list[Trace], Layout]:
    """Return a chi-square figure over time within its bounds, and its axis, which shows the bounds.

    Of a figure that is nowhere known there are no traces, and the axis is hidden.
    """
    known = np.isfinite(values) & (dof > 0)
    if not known.any():
        return [], {"visible": False}
    shown = np.where(known, values, np.nan)
    at = kept(shown, most)
    low, high = chi_square_bounds(_held(dof)[at], confidence)
    first = name == "NEES"
    axis = "y" if first else "y2"
    inside = f"{100 * confidence:g} % of a consistent one"
    traces = [
        band(at, low, high, inside, "$slate/22", yaxis=axis),
        line(at, shown[at], name, "$blue" if first else "$green", yaxis=axis, hovertemplate="%{y:.4g}"),
    ]
    if not first:
        traces[0]["legendgroup"] = inside
    return traces, log_axis(name, [shown, low, high], anchor=np.concatenate([low, high]))


def _held(dof: Ints) -> Ints:
    """Return degrees of freedom, in steps without any those of the last step that had some, at least 1."""
    some = dof > 0
    if not some.any():
        return np.ones_like(dof)
    last = np.maximum.accumulate(np.where(some, np.arange(dof.size), -1))
    return dof[np.where(last >= 0, last, np.argmax(some))]


def over_time_figure(recording: Recording, notes: list[str]) -> Figure | None:
    """Return NEES and NIS of one estimator at a time within their bounds; None when nobody gave either."""
    nees, estimates = recording.nees, recording.evidence.gathered.estimates
    nis, nis_dof = estimates.nis[:, : recording.steps], estimates.nis_dof[:, : recording.steps]
    some = np.isfinite(nees) | (nis_dof > 0)
    names = recording.names
    usable = [name for name, own in zip(names, some, strict=True) if np.any(own)]
    leading = [name for name in leading_nodes(recording.score, len(names)) if name in usable][:MOST_NODES]
    if not leading:
        return None
    if len(leading) < len(usable):
        notes.append(f"NEES and NIS over time: {len(leading)} of {len(usable)} estimators can be chosen.")
    most = points(4 * len(leading))
    if recording.steps > most:
        notes.append(f"NEES and NIS: smallest and largest of each stretch, {most:,} points a line.")
    confidence = recording.score.options.confidence
    views: dict[tuple[str, ...], View] = {}
    for name in in_order(leading, names):
        node = names.index(name)
        dof = np.full(recording.steps, recording.truth.shape[1])
        upper, above = _bounded(nees[node], dof, confidence, "NEES", most)
        lower, below = _bounded(nis[node], nis_dof[node], confidence, "NIS", most)
        if not upper or not lower:
            above, below = above | {"domain": [0, 1]}, below | {"domain": [0, 1]}
        key = [attack_key()] if recording.attacked.any() else []
        shapes = step_shapes(recording, recording.attacked[node])
        views[(name,)] = View([*upper, *lower, *key], {"shapes": shapes, "yaxis": above, "yaxis2": below})
    options = [(name, name) for name in in_order(leading, names)]
    return Figure(
        name="consistency",
        title="NEES and NIS over time",
        views=views,
        layout=over_steps(recording, stacked(["NEES", "NIS"], [0.5, 0.5], recording.plan.period_s)),
        choices=(Choice("Estimator", options, leading[0]),),
        text="Squared errors in units of what the estimator believes, on logarithmic axes. A consistent one "
        f"stays within the grey band in {100 * confidence:g} % of the steps; above, it is too "
        "sure of itself, below too careful. NEES stands at the step that the estimate is of, NIS at that in "
        "which the packets came; an estimator that tells none has no panel for it.",
        height=440,
    )


def _ratio_trace(nodes: Sequence[NodeScore], figures: Sequence[Consistency], name: str, look: int) -> Trace:
    """Return means by their degrees of freedom, with the interval in which a consistent one would lie."""
    rows = [
        (node.name, part.mean / part.dof, part.low / part.dof, part.high / part.dof)
        for node, part in zip(nodes, figures, strict=True)
        if part.mean is not None and part.dof and part.low is not None and part.high is not None
    ]
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [row[0] for row in rows],
        "y": np.array([row[1] for row in rows]),
        "name": name,
        "marker": {
            "symbol": ("circle", "diamond")[look],
            "size": 9,
            "color": ("$blue", "$green")[look],
        },
        "customdata": [[row[2], row[3]] for row in rows],
        "hovertemplate": f"{name} of %{{x}}: %{{y:.3g}}<br>if consistent and independent: "
        "%{customdata[0]:.3g} to %{customdata[1]:.3g}<extra></extra>",
    }


def summary_figure(recording: Recording) -> Figure:
    """Return the mean NEES and NIS of every estimator by their degrees of freedom; 1 is consistent."""
    nodes = recording.score.nodes
    traces = [
        _ratio_trace(nodes, [node.nees for node in nodes], "NEES", 0),
        _ratio_trace(nodes, [node.nis for node in nodes], "NIS", 1),
    ]
    traces = [trace for trace in traces if trace["x"]]
    one = np.array([1.0])
    axis = log_axis("mean by its dof", [one, *(trace["y"] for trace in traces)], anchor=one)
    dotted = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1, "layer": "below"}
    return Figure(
        name="consistency-summary",
        title="Mean NEES and NIS of each estimator, by their degrees of freedom",
        views={(): View(traces)},
        layout={
            "yaxis": axis,
            "xaxis": {"type": "category", "title": {"text": "estimator"}},
            "margin": {"t": 32},
            "shapes": [{**dotted, "line": {"color": "$muted", "width": 1.4, "dash": "dot"}}],
        },
        text="1 (dotted) is consistent; 4 means errors twice as large as believed, 0.25 half as large. "
        "Errors of neighbouring steps are alike, so one run's mean NEES is a hint and no verdict.",
        height=300,
    )
