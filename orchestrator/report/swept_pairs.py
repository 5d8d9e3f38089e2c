"""Errors over two swept numbers at once: where a threshold is good for one attack and bad for another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from orchestrator.evidence.figures import rmse
from orchestrator.evidence.intervals import Interval
from orchestrator.report.campaign_tables import interval
from orchestrator.report.contents import Choice, Figure, Trace, View
from orchestrator.report.group_pieces import first_scope, scopes, state_choice
from orchestrator.report.groups import Group, short_names
from orchestrator.report.palette import LOSS
from orchestrator.report.swept import WIDE, as_numbers, swept_paths, values_of

PAIRS = 3
"""Most pairs of paths that are drawn."""

WRITTEN = 8
"""Most columns whose cells say their error; of more, pointing at a cell tells it."""

Cells = Mapping[tuple[str, str], Group]
"""Groups by their values of two paths."""


def pair_figures(groups: Sequence[Group]) -> list[Figure]:
    """Return for every two paths swept over numbers the RMSE over both, one map for what differs otherwise.

    The first pairs only, where there are very many.
    """
    numeric = [path for path in swept_paths(groups) if _is_numeric(groups, path)]
    found: list[Figure] = []
    for pair in combinations(numeric, 2):
        # what has more values goes down: a telephone is narrow
        across, down = sorted(pair, key=lambda path: len(values_of(groups, path)))
        maps = {name: own for name, own in _maps(groups, across, down) if _is_map(own)}
        if maps:
            found.append(_figure(groups, across, down, maps, len(found)))
    return found[:PAIRS]


def _is_numeric(groups: Sequence[Group], path: str) -> bool:
    values = values_of(groups, path)
    return len(values) > 1 and as_numbers(values) is not None


def _maps(groups: Sequence[Group], across: str, down: str) -> Iterator[tuple[str, Cells]]:
    """Yield the groups that differ in nothing but two paths, under what they have in common."""
    maps: dict[str, dict[tuple[str, str], Group]] = {}
    for group in groups:
        if across in group.settings and down in group.settings:
            rest = [word for path, word in group.words.items() if path not in (across, down)]
            name = ", ".join(filter(None, (group.title, *rest, group.part)))
            maps.setdefault(name, {})[group.settings[across], group.settings[down]] = group
    yield from maps.items()


def _is_map(cells: Cells) -> bool:
    return all(len({place[side] for place in cells}) > 1 for side in (0, 1))


def _figure(
    groups: Sequence[Group], across: str, down: str, maps: Mapping[str, Cells], number: int
) -> Figure:
    state, scope = state_choice(groups), scopes(groups)
    short = short_names(swept_paths(groups))
    names = {str(i): name for i, name in enumerate(maps)}
    views: dict[tuple[str, ...], View] = {}
    most = 0
    for key, name in names.items():
        for which, _ in scope:
            for group, _ in state.options:
                trace = _trace(maps[name], which, group)
                trace["hovertemplate"] = (
                    f"{short[across]} %{{x}}, {short[down]} %{{y}}<br>"
                    f"RMSE of {group} %{{customdata}}<extra></extra>"
                )
                most = max(most, len(trace["y"]))
                views[key, group, which] = View([trace])
    return Figure(
        name="swept-pair" if not number else f"swept-pair-{number + 1}",
        title=f"RMSE over {short[across]} and {short[down]}",
        views=views,
        layout={
            "xaxis": {"type": "category", "title": {"text": across}, "showgrid": False, "ticks": ""},
            "yaxis": {"type": "category", "title": {"text": down}, "showgrid": False, "ticks": ""},
            "margin": {"l": 30, "r": 14, "t": 10, "b": 44},
        },
        choices=(
            Choice("Map of", list(names.items()), "0"),
            state,
            Choice("Of", scope, first_scope(groups)),
        ),
        text="The stronger the colour, the larger the error, in each map for itself. Pointing at a cell "
        f"tells its {100 * groups[0].confidence:g} % bootstrap interval over trials; a cell is empty where "
        "an estimator diverged.",
        height=max(110 + 46 * most, 220),
    )


def _trace(cells: Cells, which: str, state: str) -> Trace:
    """Return the map of one state group: a row a value of the second path, a column one of the first."""
    columns, rows = (_ascending({place[side] for place in cells}) for side in (0, 1))
    found = [[_error(cells.get((column, row)), which, state) for column in columns] for row in rows]
    values = np.array([[own.value for own in line] for line in found])
    values = np.where(np.isfinite(values), values, np.nan)
    text = [["" if np.isnan(value) else f"{value:.3g}" for value in line] for line in values]
    trace = {
        "type": "heatmap",
        "x": columns,
        "y": rows,
        "z": _strength(values).tolist(),
        "text": text,
        "customdata": [[interval(own) for own in line] for line in found],
        "colorscale": [[rank / (len(LOSS) - 1), f"$loss{rank}"] for rank in range(len(LOSS))],
        "showscale": False,
        "xgap": 2,
        "ygap": 2,
    }
    return trace | ({"texttemplate": "%{text}", "textfont": {"size": 13}} if len(columns) <= WRITTEN else {})


def _error(group: Group | None, which: str, state: str) -> Interval:
    rows = None if group is None else group.of(which)
    if group is None or rows is None or not rows.trial.size:
        return Interval(np.nan, np.nan, np.nan)
    return rmse(rows, state, group.confidence)


def _ascending(values: set[str]) -> list[str]:
    return sorted(values, key=float)


def _strength(values: np.ndarray) -> np.ndarray:
    """Return what colours stand for: errors, or their logarithms where some are far larger than others."""
    known = values[np.isfinite(values)]
    is_wide = known.size and known.min() > 0.0 and known.max() > WIDE * known.min()
    return np.log10(values) if is_wide else values
