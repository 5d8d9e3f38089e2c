"""The axis of a run's steps: as far as the record goes, with its end marked where the run was to go on."""

from __future__ import annotations

from typing import Any

from orchestrator.report.contents import Layout
from orchestrator.report.lines import attack_shapes, step_axis
from orchestrator.report.recording import Recording
from orchestrator.score.gather import Bools

_BEYOND = 0.02
"""How far the axis goes on after a record that ends early, as a share of it."""


def over_steps(recording: Recording, layout: Layout) -> Layout:
    """Return a layout whose axis is that of the run's steps, cut at the last one of an early end."""
    axis = {**step_axis(recording.plan.period_s), **layout.get("xaxis", {})}
    if recording.steps == recording.plan.steps:
        return {**layout, "xaxis": axis}
    axis["range"] = [axis.get("range", [0])[0], recording.steps * (1.0 + _BEYOND)]
    told = f"recorded to step {recording.steps - 1:,} of {recording.plan.steps - 1:,}"
    note = {
        "x": recording.steps - 0.5,
        "xref": "x",
        "xanchor": "right",
        "y": 1,
        "yref": "paper",
        "yanchor": "bottom",
        "text": told,
        "showarrow": False,
        "font": {"size": 12, "color": "$muted"},
    }
    return {**layout, "xaxis": axis, "annotations": [note], "margin": {"t": 32}}


def step_shapes(recording: Recording, marks: Bools) -> list[dict[str, Any]]:
    """Return the shading of marked steps (K,), and a line at the end of a record that ends early."""
    shapes = attack_shapes(marks)
    if recording.steps < recording.plan.steps:
        end = recording.steps - 0.5
        line = {"type": "line", "xref": "x", "yref": "paper", "x0": end, "x1": end, "y0": 0, "y1": 1}
        shapes.append({**line, "line": {"color": "$muted", "width": 1.4, "dash": "dot"}})
    return shapes
