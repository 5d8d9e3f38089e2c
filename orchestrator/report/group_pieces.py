"""Pieces of figures in which groups of estimators stand side by side."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.evidence.bootstrap import Band
from orchestrator.evidence.intervals import Interval
from orchestrator.report.contents import Choice, Trace
from orchestrator.report.groups import ALL, ATTACKED, Group, state_names
from orchestrator.report.lines import band, line, log_axis, value_axis
from orchestrator.report.palette import series_style
from orchestrator.report.thinning import kept
from orchestrator.score.gather import Floats

SHOWN = 8
"""Groups that are drawn at first."""

LABEL = 20
"""Most letters of a line of an axis' label."""


def visible(number: int) -> dict[str, Any]:
    """Return what hides a trace at first, when it is of a late group."""
    return {} if number < SHOWN else {"visible": "legendonly"}


def band_traces(found: Band, name: str, number: int, **more: Any) -> list[Trace]:
    """Return a band and its curve, in the style of a number; both go by one key of the legend."""
    at = kept(found.value)
    style, look = series_style(number), {**visible(number), **more}
    colour = style["color"]
    shade = band(at, found.low[at], found.high[at], name, f"{colour}/13", **{**look, "showlegend": False})
    middle = line(at, found.value[at], name, colour, dash=style["dash"], hovertemplate="%{y:.4g}", **look)
    return [shade, {**middle, "legendgroup": name}]


def points_trace(x: Floats, found: Sequence[Interval], name: str, number: int) -> Trace:
    """Return points (N,) joined by a line, each with its interval, in the style of a number."""
    values, low, high = (np.array([getattr(own, side) for own in found]) for side in ("value", "low", "high"))
    values = np.where(np.isfinite(values), values, np.nan)
    style = series_style(number)
    bars = {
        "type": "data",
        "symmetric": False,
        "array": np.nan_to_num(high - values),
        "arrayminus": np.nan_to_num(values - low),
        "thickness": 1.2,
        "color": style["color"],
    }
    drawn = line(x, values, name, style["color"], dash=style["dash"], error_y=bars, hovertemplate="%{y:.4g}")
    return {**drawn, "mode": "lines+markers", "marker": {"color": style["color"], "size": 7}}


def scopes(groups: Sequence[Group]) -> list[tuple[str, str]]:
    """Return the choices of estimators: all, and the attacked ones where these are fewer."""
    found = [(ALL, "all estimators")]
    if any(0 < len(group.attacked) < len(group.nodes) for group in groups):
        found.append((ATTACKED, "attacked estimators only"))
    return found


def first_scope(groups: Sequence[Group]) -> str:
    """Return which estimators are shown first: the attacked ones, unless that would leave a group out."""
    return ATTACKED if scopes(groups)[1:] and all(group.attacked for group in groups) else ALL


def state_choice(groups: Sequence[Group]) -> Choice:
    """Return the choice of a state group."""
    names = state_names(groups)
    return Choice(
        "State group", [(name, "whole state" if name == "state" else name) for name in names], names[0]
    )


def error_axis(title: str, values: Sequence[Floats]) -> dict[str, Any]:
    """Return an axis of errors: logarithmic where few of them are far larger than most."""
    known = np.concatenate([v[np.isfinite(v) & (v > 0)] for v in values] or [np.zeros(0)])
    if known.size and known.max() > 50.0 * np.median(known):
        return log_axis(title, [known])
    return value_axis(title, rangemode="tozero")


def label(group: Group) -> str:
    """Return a name for an axis, broken into short lines at commas and underscores."""
    lines = [""]
    for part in re.findall(r"[^,_]+[,_]?", group.name):
        if lines[-1] and len(lines[-1]) + len(part) > LABEL:
            lines.append("")
        lines[-1] += part
    return "<br>".join(own.strip() for own in lines)


def height(groups: Sequence[Group], row: int) -> int:
    """Return the height (pixels) of a figure with a row a group, tall enough for the rows' labels."""
    lines = max(label(group).count("<br>") + 1 for group in groups)
    return max(100 + len(groups) * max(row, 16 * lines + 10), 180)
