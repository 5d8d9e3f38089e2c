"""Detectors against the channel's truth: verdicts over time, and what other thresholds would give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.evidence.roc import Roc, roc
from orchestrator.report.contents import Choice, Figure, Layout, Trace, View
from orchestrator.report.lines import attack_key, attack_shapes, log_axis, step_axis, value_axis
from orchestrator.report.palette import series_style
from orchestrator.report.recording import Recording
from orchestrator.report.thinning import kept, leading_nodes, points
from orchestrator.score.gather import Bools, Floats, Ints

MOST_NODES = 60
CURVE_POINTS = 400


@dataclass(frozen=True)
class Verdicts:
    """The packets (P,) that a detector judged with a statistic: link, step, statistic, attacked, rejected."""

    link: Ints
    step: Ints
    statistic: Floats
    attacked: Bools
    alarm: Bools

    def of(self, rows: Bools) -> Verdicts:
        """Return some of the rows."""
        return Verdicts(
            self.link[rows], self.step[rows], self.statistic[rows], self.attacked[rows], self.alarm[rows]
        )


def verdicts(recording: Recording) -> Verdicts:
    """Return all packets with a statistic."""
    found = recording.evidence.judgement
    whole = Verdicts(found.link, found.step, found.statistic, found.attacked, found.alarm)
    return whole.of(np.isfinite(found.statistic))


def by_estimator(recording: Recording) -> dict[str, Verdicts]:
    """Return the judged packets of each estimator that judged any, in the plan's order."""
    whole = verdicts(recording)
    receiver = np.array([link.destination for link in recording.plan.links], dtype=object)
    receivers = receiver[whole.link] if whole.link.size else np.zeros(0, dtype=object)
    own = {name: whole.of(np.asarray(receivers == name, dtype=bool)) for name in recording.names}
    return {name: rows for name, rows in own.items() if rows.link.size}


_FATES = (
    ("genuine, accepted", False, False, {"symbol": "circle", "size": 5, "color": "$slate/70"}),
    ("genuine, rejected", False, True, {"symbol": "triangle-up", "size": 10, "color": "$pink"}),
    (
        *("attacked, accepted", True, False),
        {"symbol": "circle-open", "size": 10, "color": "$attack", "line": {"width": 2.4, "color": "$attack"}},
    ),
    ("attacked, rejected", True, True, {"symbol": "diamond", "size": 9, "color": "$attack"}),
)


def _fate_traces(rows: Verdicts, links: Sequence[str], most: int) -> list[Trace]:
    traces = []
    only = links[rows.link[0]] if np.all(rows.link == rows.link[0]) else ""
    for name, attacked, alarm, marker in _FATES:
        own = rows.of((rows.attacked == attacked) & (rows.alarm == alarm))
        order = np.argsort(own.step, kind="stable")
        at = order[kept(own.statistic[order], most)]
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": own.step[at],
                "y": own.statistic[at],
                "name": name,
                **({} if only else {"text": [links[link] for link in own.link[at]]}),
                "marker": marker,
                "hovertemplate": f"step %{{x}}, {only or '%{text}'}<br>{name}: %{{y:.4g}}<extra></extra>",
            }
        )
    return traces


def _statistic_axis(statistic: Floats, threshold: float | None) -> dict[str, Any]:
    positive = statistic[statistic > 0.0]
    if not statistic.size or positive.size < statistic.size:
        return value_axis("test statistic")
    few, most = np.quantile(positive, [0.05, 0.95])
    if positive.max() <= 30.0 * np.median(positive) and most <= 100.0 * few:
        return value_axis("test statistic")
    low = np.quantile(positive, 0.01) if positive.size > 100 else positive.min()
    shown = [np.array([low]), positive[positive >= low]]
    return log_axis("test statistic", [*shown, np.array([threshold])] if threshold else shown)


def _threshold(parameters: Mapping[str, Any], rows: Verdicts) -> float | None:
    """Return an estimator's parameter ``threshold`` where it is what parts its alarms from the rest."""
    value = parameters.get("threshold")
    if not isinstance(value, int | float) or isinstance(value, bool) or value <= 0:
        return None
    parts = bool(np.all(rows.statistic[rows.alarm] >= value) and np.all(rows.statistic[~rows.alarm] <= value))
    return float(value) if parts else None


def _threshold_look(threshold: float) -> Layout:
    line = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": threshold, "y1": threshold}
    return {**line, "line": {"color": "$ink", "width": 1.4, "dash": "dash"}}


def _threshold_key(threshold: float) -> Trace:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": [None],
        "y": [None],
        "name": f"threshold {threshold:g}",
        "line": {"color": "$ink", "width": 1.4, "dash": "dash"},
        "hoverinfo": "skip",
    }


def timeline_figure(recording: Recording, notes: list[str]) -> Figure | None:
    """Return the verdicts of one estimator at a time, by step and truth; None when nobody gave any."""
    held = by_estimator(recording)
    leading = [name for name in leading_nodes(recording.score, len(recording.names)) if name in held]
    if not leading:
        return None
    chosen = [name for name in held if name in set(leading[:MOST_NODES])]
    if len(chosen) < len(held):
        notes.append(f"Detectors over time: {len(chosen)} of {len(held)} estimators can be chosen.")
    most = points(len(_FATES) * len(chosen))
    if max(rows.step.size for rows in held.values()) > most:
        notes.append(f"Detectors over time: at most {most:,} packets of each fate, the extremes among them.")
    links = [link.name for link in recording.plan.links]
    parameters = {own.name: own.kind.parameters for own in recording.plan.estimators}
    views: dict[tuple[str, ...], View] = {}
    for name in chosen:
        threshold = _threshold(parameters[name], held[name])
        shapes = attack_shapes(recording.attacked[recording.names.index(name)])
        traces = [*_fate_traces(held[name], links, most), attack_key()]
        if threshold is not None:
            shapes.append(_threshold_look(threshold))
            traces.append(_threshold_key(threshold))
        axis = _statistic_axis(held[name].statistic, threshold)
        views[(name,)] = View(traces, {"shapes": shapes, "yaxis": axis})
    marks = {node.name: " (attacked)" if node.attacked_steps else "" for node in recording.score.nodes}
    return Figure(
        name="detection",
        title="Verdicts over time, against the channel's truth",
        views=views,
        layout={
            "xaxis": {**step_axis(recording.plan.period_s), "range": [-1, recording.plan.steps]},
        },
        choices=(Choice("Estimator", [(name, f"{name}{marks[name]}") for name in chosen], leading[0]),),
        text="A point is a packet that this estimator judged. Its colour says what the channel did to it, "
        "its shape what the detector made of it: diamonds are attacks found, open circles attacks missed, "
        "triangles false alarms.",
        height=360,
    )


@dataclass(frozen=True)
class Curve:
    """An ROC with its name, and where the detector really stood (false alarms, detections), if it did."""

    name: str
    roc: Roc
    stood: tuple[float, float] | None = None


def stood_at(attacked: Bools, alarm: Bools) -> tuple[float, float]:
    """Return the false-alarm rate and the detection rate of verdicts that were given."""
    return float(alarm[~attacked].mean()), float(alarm[attacked].mean())


def _curve_traces(curve: Curve, number: int) -> list[Trace]:
    found = curve.roc
    at = kept(np.arange(found.threshold.size, dtype=np.float64), CURVE_POINTS)
    area = found.area
    interval = f" [{area.low:.3f}, {area.high:.3f}]" if np.isfinite(area.low) else ""
    name = f"{curve.name}: AUC {area.value:.3f}{interval}"
    style = series_style(number)
    traces: list[Trace] = [
        {
            "type": "scatter",
            "mode": "lines",
            "x": found.false_alarm_rate[at],
            "y": found.detection_rate[at],
            "customdata": [
                None if np.isinf(value) else float(f"{value:.4g}") for value in found.threshold[at]
            ],
            "line": {"width": 2.2, **style},
            "name": name,
            "hovertemplate": "threshold %{customdata}<br>false alarms %{x:.3g}<br>detected %{y:.3g}"
            "<extra></extra>",
        }
    ]
    if curve.stood is not None:
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": [curve.stood[0]],
                "y": [curve.stood[1]],
                "legendgroup": name,
                "showlegend": False,
                "name": name,
                "marker": {"symbol": "circle", "size": 11, "color": style["color"]},
                "hovertemplate": f"{curve.name}, as it stood<br>false alarms %{{x:.3g}}<br>"
                "detected %{y:.3g}<extra></extra>",
            }
        )
    return traces


def roc_figure(curves: Sequence[Curve]) -> Figure | None:
    """Return ROC curves; None when none has both attacked and genuine packets."""
    usable = [curve for curve in curves if curve.roc.threshold.size]
    if not usable:
        return None
    chance = {
        "type": "scatter",
        "mode": "lines",
        "x": [0, 1],
        "y": [0, 1],
        "name": "chance",
        "line": {"color": "$muted", "width": 1.2, "dash": "dot"},
        "hoverinfo": "skip",
    }
    unit = usable[0].roc.unit
    traces = [trace for number, curve in enumerate(usable) for trace in _curve_traces(curve, number)]
    share = {"range": [-0.02, 1.02], "tickformat": ".0%", "zeroline": False}
    return Figure(
        name="roc",
        title="ROC: what other thresholds would give",
        views={(): View([*traces, chance])},
        layout={
            "xaxis": {**share, "title": {"text": "genuine packets rejected"}},
            "yaxis": {**share, "title": {"text": "attacked packets rejected"}},
        },
        text="The dot is where the detector stood. AUC, the area under the curve, is the probability that an "
        f"attacked packet has a larger statistic than a genuine one; its interval is over {unit}.",
        aspect=0.72,
    )


def run_curves(recording: Recording) -> list[Curve]:
    """Return the ROC of each method of a run, its estimators' packets pooled."""
    methods = {node.name: node.method for node in recording.score.nodes}
    pooled: dict[str, list[Verdicts]] = {}
    for name, rows in by_estimator(recording).items():
        pooled.setdefault(methods[name], []).append(rows)
    curves = []
    for method, parts in pooled.items():
        statistic = np.concatenate([rows.statistic for rows in parts])
        attacked = np.concatenate([rows.attacked for rows in parts])
        alarm = np.concatenate([rows.alarm for rows in parts])
        found = roc(statistic, attacked, confidence=recording.score.options.confidence)
        stood = stood_at(attacked, alarm) if found.threshold.size else None
        curves.append(Curve(method, found, stood))
    return curves
