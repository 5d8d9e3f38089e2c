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

DRAWN = 8
"""Most curves that are seen before anybody asks for more."""

LABEL = 20
"""Most letters of a line of an axis' label."""

LINES = 2
"""Most lines of the labels of an axis with more than a few groups: where one is longer, all are numbers."""

NAMED = 5
"""Most groups that an axis names at any length."""


def visible(number: int) -> dict[str, Any]:
    """Return what hides a trace at first, when it is a late one."""
    return {} if number < DRAWN else {"visible": "legendonly"}


def seen_first(ranks: Sequence[int]) -> list[dict[str, Any]]:
    """Return what hides curves at first: all of them but those of the first ranks."""
    last = sorted(ranks)[:DRAWN][-1:]
    return [{"visible": True if [rank] <= last else "legendonly"} for rank in ranks]


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


def labels(groups: Sequence[Group]) -> list[str]:
    """Return names for an axis, or numbers of the table of variants where names would fill the page."""
    names = [_broken(group.name) for group in groups]
    if len(groups) > NAMED and max(name.count("<br>") + 1 for name in names) > LINES:
        return [f"{group.number}" for group in groups]
    return names


def told_of_labels(groups: Sequence[Group]) -> str:
    """Return the sentence that says what the numbers on an axis are, nothing where there are names."""
    is_numbered = labels(groups)[0] == f"{groups[0].number}"
    return " The numbers are those of the table of variants." if is_numbered else ""


def _broken(name: str) -> str:
    """Return a name broken into short lines at commas and underscores."""
    lines = [""]
    for part in re.findall(r"[^,_]+[,_]?", name):
        if lines[-1] and len(lines[-1]) + len(part) > LABEL:
            lines.append("")
        lines[-1] += part
    return "<br>".join(own.strip() for own in lines)


def height(groups: Sequence[Group], row: int) -> int:
    """Return the height (pixels) of a figure with a row a group: at most ``row`` where labels are short."""
    lines = max(own.count("<br>") + 1 for own in labels(groups))
    each = min(row, 28) if told_of_labels(groups) else max(row, 16 * lines + 10)
    return max(100 + len(groups) * each, 180)
