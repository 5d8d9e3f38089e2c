"""Pieces of figures that several themes use: lines, bands, shaded attacks, axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.report.contents import Layout, Trace
from orchestrator.report.thinning import stretches_of
from orchestrator.score.gather import Bools, Floats, Ints

ATTACK_NAME = "an attack is on"

DECADES = 9.0
"""The most powers of ten that a logarithmic axis spans."""

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def line(x: Ints | Floats, y: Floats, name: str, colour: str, **more: Any) -> Trace:
    """Return a line; further keys go into its ``line`` when Plotly's lines have them, else into the trace."""
    style = {key: more.pop(key) for key in ("width", "dash", "shape") if key in more}
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": name,
        "line": {"color": colour, "width": 1.8, **style},
        **more,
    }


def band(x: Ints | Floats, low: Floats, high: Floats, name: str, colour: str, **more: Any) -> Trace:
    """Return a filled band between two lines, with gaps where either is unknown; it has no hover."""
    xs, ys = _outline(np.asarray(x, dtype=np.float64), low, high)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": xs,
        "y": ys,
        "line": {"width": 0, "color": colour},
        "fill": "toself",
        "fillcolor": colour,
        "hoverinfo": "skip",
        "legendgroup": name,
        "name": name,
        **more,
    }


def _outline(x: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return the outlines of a band's whole stretches, NaN between them."""
    known = np.flatnonzero(np.isfinite(low) & np.isfinite(high))
    if not known.size:
        return np.zeros(0), np.zeros(0)
    parts = np.split(known, np.flatnonzero(np.diff(known) > 1) + 1)
    apart = np.array([np.nan])
    xs = [np.concatenate([x[own], x[own][::-1], apart]) for own in parts]
    ys = [np.concatenate([low[own], high[own][::-1], apart]) for own in parts]
    return np.concatenate(xs)[:-1], np.concatenate(ys)[:-1]


def stairs(x: Ints | Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return a line that keeps each value until the next begins."""
    return np.repeat(np.asarray(x, dtype=np.float64), 2)[1:], np.repeat(y, 2)[:-1]


def attack_shapes(marks: Bools) -> list[dict[str, Any]]:
    """Return the shading of the steps that are marked, over all rows; fainter where most are."""
    stretches = stretches_of(marks)
    shaded = sum(last + 1 - first for first, last in stretches)
    colour = "$attack/18" if shaded < 0.5 * marks.size else "$attack/8"
    return [
        {
            "type": "rect",
            "xref": "x",
            "yref": "paper",
            "x0": first - 0.5,
            "x1": last + 0.5,
            "y0": 0,
            "y1": 1,
            "line": {"width": 0},
            "fillcolor": colour,
            "layer": "below",
        }
        for first, last in stretches
    ]


def attack_key() -> Trace:
    """Return a trace without points that puts the shading into the legend."""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [None],
        "y": [None],
        "name": ATTACK_NAME,
        "marker": {"symbol": "square", "size": 11, "color": "$attack/35"},
        "hoverinfo": "skip",
    }


def step_axis(*periods_s: float) -> dict[str, Any]:
    """Return the axis of steps, which tells how long one is, if all are as long."""
    told = f"step (of {periods_s[0]:g} s)" if len(set(periods_s)) == 1 else "step"
    return {"title": {"text": told}, "rangemode": "tozero", "zeroline": False}


def value_axis(title: str, **more: Any) -> dict[str, Any]:
    """Return an axis of values."""
    return {"title": {"text": title}, **more}


def log_axis(title: str, values: Sequence[Floats] = (), anchor: Floats | None = None) -> dict[str, Any]:
    """Return a logarithmic axis with few, plain labels, of what is positive among values.

    Where that spans more than `DECADES` the axis is cut around the median of ``anchor``: what must be seen,
    such as a consistency band; else of all values. `orchestrator.report.edges` shows what lies beyond.
    """
    axis: dict[str, Any] = {"title": {"text": title}, "type": "log", "minor": {"ticks": ""}}
    positive = _powers(values)
    if not positive.size:
        return axis
    low, high = float(positive.min()), float(positive.max())
    room = max(0.12, 0.02 * min(high - low, DECADES))
    low, high = low - room, high + room
    if high - low > DECADES:
        wanted = _powers([] if anchor is None else [anchor])
        middle = float(np.median(wanted if wanted.size else positive))
        high = min(high, max(middle + 0.5 * DECADES, low + DECADES))
        low = max(low, high - DECADES)
    ticks = _log_ticks(low, high)
    return axis | {
        "range": [low, high],
        "tickvals": ticks,
        "ticktext": [_tick_text(tick) for tick in ticks],
    }


def _powers(values: Sequence[Floats]) -> Floats:
    """Return the decadic logarithms of all that is finite and positive."""
    known = [np.log10(own[np.isfinite(own) & (own > 0)]) for own in values]
    return np.concatenate([np.zeros(0), *known])


def _tick_text(tick: float) -> str:
    if 1e-4 < tick < 1e5:
        return f"{tick:.10g}"
    lead, _, power = f"{tick:.0e}".partition("e")
    return f"{'' if lead == '1' else lead + '·'}10{str(int(power)).translate(_RAISED)}"


def _log_ticks(bottom: float, top: float) -> list[float]:
    """Return three to eight round values between two powers of ten."""
    span = top - bottom
    decades = range(int(np.floor(bottom)), int(np.ceil(top)) + 1)
    leading = (1,) if span > 2.5 else (1, 3) if span > 1.2 else (1, 2, 5)
    every = max(1, int(np.ceil(span / 7.0)))
    ticks = [float(f"{lead}e{power}") for power in decades if power % every == 0 for lead in leading]
    return [tick for tick in ticks if bottom <= np.log10(tick) <= top]


def stacked(titles: Sequence[str], shares: Sequence[float], period_s: float, gap: float = 0.07) -> Layout:
    """Return the layout of rows that share the axis of steps: from the top, each with its share of height."""
    layout: Layout = {"hovermode": "x unified"}
    scale = (1.0 - gap * (len(titles) - 1)) / sum(shares)
    top = 1.0
    for row, (title, share) in enumerate(zip(titles, shares, strict=True), start=1):
        bottom = max(top - share * scale, 0.0)
        layout["yaxis" if row == 1 else f"yaxis{row}"] = {
            "title": {"text": title},
            "domain": [round(bottom, 4), round(top, 4)],
        }
        top = bottom - gap
    layout["xaxis"] = {**step_axis(period_s), "anchor": "free" if len(titles) > 1 else "y", "position": 0.0}
    return layout
