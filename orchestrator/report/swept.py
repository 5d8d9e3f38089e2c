"""Errors over the values of what was swept: what a loss, a threshold or a gain does to an estimator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.evidence.figures import rmse
from orchestrator.evidence.table import SWEPT
from orchestrator.report.contents import Choice, Figure, Layout, Trace, View
from orchestrator.report.group_pieces import (
    first_scope,
    points_trace,
    scopes,
    seen_first,
    state_choice,
)
from orchestrator.report.groups import Group, short_names
from orchestrator.report.lines import log_axis, value_axis
from orchestrator.score.gather import Floats

FEWEST = 3
"""Fewest values that make a curve where none is asked for: two stand beside each other in the tables."""

WIDE = 50.0
"""The largest value over the smallest from which on an axis is logarithmic."""

_PATHS = ("node", "method", "variant", None)


def swept_figure(groups: Sequence[Group], by: str | None = None) -> Figure | None:
    """Return the RMSE over the values of a path that was swept, with a line for what differs in nothing else.

    The paths are those with enough numbers as values, or the one ``by`` which the variants are told apart,
    whatever its values. None where there is none.
    """
    asked = None if by in _PATHS else str(by).removeprefix(SWEPT)
    paths = [path for path in swept_paths(groups) if path == asked or (not asked and _is_curve(groups, path))]
    if not paths:
        return None
    short = short_names(swept_paths(groups))
    state, scope = state_choice(groups), scopes(groups)
    views: dict[tuple[str, ...], View] = {
        (path, name, which): _view(groups, path, name, which)
        for path in paths
        for name, _ in state.options
        for which, _ in scope
    }
    return Figure(
        name="swept",
        title=f"RMSE over {short[paths[0]] if len(paths) == 1 else 'what was swept'}",
        views=views,
        choices=(
            Choice("Over", [(path, path) for path in paths], paths[0]),
            state,
            Choice("Of", scope, first_scope(groups)),
        ),
        text=f"Each point with its {100 * groups[0].confidence:g} % bootstrap interval over trials. "
        "A line joins variants that differ in nothing else; where an estimator diverged it has no point.",
        height=360,
    )


def swept_paths(groups: Sequence[Group]) -> list[str]:
    """Return the paths that have several values, in the order of the command line."""
    return list(dict.fromkeys(path for group in groups for path in group.settings))


def values_of(groups: Sequence[Group], path: str) -> list[str]:
    """Return the different values of a path, in the order of the variants."""
    return list(dict.fromkeys(group.settings[path] for group in groups if path in group.settings))


def as_numbers(values: Sequence[str]) -> Floats | None:
    """Return values as finite numbers, None unless all are."""
    try:
        found = np.array([float(value) for value in values])
    except ValueError:
        return None
    return found if np.isfinite(found).all() else None


def _is_curve(groups: Sequence[Group], path: str) -> bool:
    values = values_of(groups, path)
    return len(values) >= FEWEST and as_numbers(values) is not None


def _view(groups: Sequence[Group], path: str, state: str, which: str) -> View:
    values = values_of(groups, path)
    numbers = as_numbers(values)
    places = dict(zip(values, np.arange(len(values)) if numbers is None else numbers, strict=True))
    traces: list[Trace] = []
    lines = _lines(groups, path)
    looks = seen_first([min(group.rank for group in own) for own in lines.values()])
    for number, ((name, own), look) in enumerate(zip(lines.items(), looks, strict=True)):
        own = [group for group in own if group.of(which).trial.size]
        x = np.array([places[group.settings[path]] for group in own], dtype=np.float64)
        order = np.argsort(x, kind="stable")
        found = [rmse(own[i].of(which), state, own[i].confidence) for i in order]
        traces.append({**points_trace(x[order], found, name, number), **look})
    heights = np.concatenate([trace["y"] for trace in traces])
    title, known = f"RMSE of {state}", heights[heights > 0.0]
    y_axis = log_axis(title, [known]) if _is_wide(known) else value_axis(title, rangemode="tozero")
    return View(traces, {"xaxis": _axis(path, values, numbers), "yaxis": y_axis})


def _axis(path: str, values: Sequence[str], numbers: Floats | None) -> Layout:
    if numbers is None:
        return value_axis(path, tickvals=list(range(len(values))), ticktext=list(values))
    return log_axis(path, [numbers]) if _is_wide(numbers) else value_axis(path)


def _is_wide(values: Floats) -> bool:
    return bool(values.size and values.min() > 0.0 and values.max() > WIDE * values.min())


def _lines(groups: Sequence[Group], path: str) -> dict[str, list[Group]]:
    """Return the groups that differ in nothing but a path, under what they have in common."""
    parts = {group.part for group in groups}
    found: dict[str, list[Group]] = {}
    for group in groups:
        if path not in group.settings:
            continue
        shown = [group.title, *(word for other, word in group.words.items() if other != path)]
        if len(parts) > 1 or not any(shown):
            shown.append(group.part)
        found.setdefault(", ".join(filter(None, shown)), []).append(group)
    return found
