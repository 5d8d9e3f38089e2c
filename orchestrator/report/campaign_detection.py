"""Detection over many trials: ROC, how long attacks stay unseen, and what earlier alarms would cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.evidence.bootstrap import Band
from orchestrator.evidence.detectors import Detection, detection
from orchestrator.report.contents import Figure, Trace, View
from orchestrator.report.detection import Curve, roc_figure
from orchestrator.report.group_pieces import visible
from orchestrator.report.groups import Group
from orchestrator.report.lines import band, line, log_axis, stairs, value_axis
from orchestrator.report.palette import series_style

WHOLE_STEPS = 10
"""How many steps an axis has at most whose every step has a tick."""


def detections(groups: Sequence[Group]) -> dict[str, Detection]:
    """Return what is known of the detectors of each group that has any, by its name."""
    found = {}
    for group in groups:
        if group.judged.flat("packet.alarm")[1].size:
            found[group.name] = detection(group.judged, confidence=group.confidence)
    return found


def roc_curves(found: Mapping[str, Detection]) -> Figure | None:
    """Return the ROC of each group; None when none has attacked and genuine packets."""
    return roc_figure(
        [Curve(name, own.roc, (own.false_alarm_rate.value, own.recall.value)) for name, own in found.items()]
    )


def survival_figure(found: Mapping[str, Detection]) -> Figure | None:
    """Return the share of attacks that are still unseen after so many steps."""
    traces: list[Trace] = []
    for number, (name, own) in enumerate(found.items()):
        if own.delay.windows:
            curve = Band(own.delay.survival, own.delay.low, own.delay.high)
            traces += _stairs(curve, f"{name}: {own.delay.found} of {own.delay.windows} found", number)
    if not traces:
        return None
    longest = max(own.delay.survival.size for own in found.values() if own.delay.windows)
    whole = {"dtick": 1} if longest < WHOLE_STEPS else {}
    return Figure(
        name="survival",
        title="How long attacks stay unseen",
        views={(): View(traces)},
        layout={
            "xaxis": {"title": {"text": "steps of the attack that went by"}, "rangemode": "tozero", **whole},
            "yaxis": {
                "title": {"text": "attacks without an alarm"},
                "tickformat": ".0%",
                "range": [-0.02, 1.04],
            },
            "hovermode": "x unified",
        },
        text="Kaplan-Meier: an attack that was never found counts as unseen for as long as it was watched. "
        "Bands are intervals over trials: by the bootstrap, and where all trials are alike by how many "
        "others may differ.",
        height=360,
    )


def _stairs(found: Band, name: str, number: int) -> list[Trace]:
    at = np.arange(found.value.size + 1)
    (x, value), (_, low), (_, high) = (
        stairs(at, np.concatenate([[1.0], part])) for part in (found.value, found.low, found.high)
    )
    style = series_style(number)
    look = {"legendgroup": name, **visible(number)}
    shade = band(x, low, high, name, f"{style['color']}/13", **{**look, "showlegend": False})
    return [shade, line(x, value, name, style["color"], dash=style["dash"], hovertemplate="%{y:.1%}", **look)]


def operating_figure(found: Mapping[str, Detection]) -> Figure | None:
    """Return mean detection delay against the time between false alarms, over thresholds."""
    traces: list[Trace] = []
    for number, (name, own) in enumerate(found.items()):
        points = [point for point in own.curve if np.isfinite(point.between_false_alarms)]
        if not points:
            continue
        style = series_style(number)
        x = np.array([point.between_false_alarms for point in points])
        y = np.array([point.delay.restricted_mean.value for point in points])
        trace = line(x, y, name, style["color"], dash=style["dash"], mode="lines+markers")
        traces.append(
            {
                **trace,
                "marker": {"size": 5, "color": style["color"]},
                "customdata": [float(f"{point.threshold:.4g}") for point in points],
                "hovertemplate": f"{name}<br>threshold %{{customdata}}: delay %{{y:.3g}} steps, "
                "a false alarm every %{x:.3g} packets<extra></extra>",
                **visible(number),
            }
        )
    if not traces:
        return None
    return Figure(
        name="operating",
        title="What earlier alarms cost",
        views={(): View(traces)},
        layout={
            "xaxis": log_axis("genuine packets between two false alarms", [trace["x"] for trace in traces]),
            "yaxis": value_axis("mean delay (steps)", rangemode="tozero"),
        },
        text="Each point is a threshold. Low and right is better. The mean is that of the Kaplan-Meier curve "
        "up to the longest time that any attack was watched: the delay of a missed attack is longer than it "
        "was watched itself, and counts with what the others show of the time after.",
        height=340,
    )
