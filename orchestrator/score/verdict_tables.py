"""The verdict's tables: the estimators, and the attacks that reached them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from orchestrator.score.fitted_table import GAP, Column, fit, fitted
from orchestrator.score.measure import node_value
from orchestrator.score.remarks import alarm_after, false_alarms, rejected, remarks, trusted_after
from orchestrator.score.results import AttackScore, Consistency, NodeScore, Score

ATTACKED_ROWS = 4
"""Attacked estimators that get a row of their own, for each method; those with the largest errors."""

WINDOW_ROWS = 6

SIGNAL_ROWS = 8

GROUP_COLUMNS = 3

REMARK = 20
"""Fewest letters of a line in which a longer remark stands beside its figures."""


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:#.3g}".removesuffix(".")


def _per_dof(figures: Consistency) -> str:
    return _figure(figures.mean / figures.dof) if figures.mean is not None and figures.dof else "-"


def _badness(node: NodeScore) -> float:
    rmse = node.groups["state"].rmse
    return float("inf") if rmse is None else rmse


def _rows(nodes: Sequence[NodeScore]) -> list[tuple[str, NodeScore]]:
    """Return one method's rows: all when they are few, else best, median, worst, and attacked ones."""
    ranked = sorted(nodes, key=_badness)
    if len(ranked) <= 3:
        return [("", node) for node in nodes]
    rows = [("best", ranked[0]), ("median", ranked[(len(ranked) - 1) // 2]), ("worst", ranked[-1])]
    shown = {node.name for _, node in rows}
    marked = [node for node in ranked if node.attacked_steps and node.name not in shown]
    chosen = {node.name for node in marked[-ATTACKED_ROWS:]}
    return rows + [("", node) for node in nodes if node.name in chosen]


def _group_columns(score: Score) -> list[str]:
    """Return the state groups that get a column: the plant's own when they are few, else the whole state."""
    own = [group for group in score.nodes[0].groups if group != "state"] if score.nodes else []
    return own if 0 < len(own) <= GROUP_COLUMNS else ["state"]


def estimator_tables(score: Score, width: int) -> Group:
    """Return the estimators by method: RMSE by state group, NEES and NIS by degree of freedom.

    A remark stands beside its figures, or below them where there is no room.
    """
    groups = _group_columns(score)
    shown = [(method, _rows(nodes)) for method, nodes in _by_method(score).items()]
    rows = {node.name: _estimator_row(node, groups) for _, own in shown for _, node in own}
    told = {
        node.name: ", ".join([*([rank] if rank else []), *remarks(node, score)])
        for _, own in shown
        for rank, node in own
    }
    columns = [Column("node", words=True), *map(Column, groups[:1])]
    columns += [Column(group, leave_out=index) for index, group in enumerate(groups[1:], start=1)]
    columns += [Column("NEES", leave_out=len(groups)), Column("NIS", leave_out=len(groups) + 1)]
    found = fit(columns, [*rows.values(), [" " * 5] * len(columns)], width)
    room = width - found.width - GAP
    beside = room >= min(REMARK, max(map(len, told.values()), default=0))
    parts: list[RenderableType] = [
        Text("RMSE by state group, ranked by the whole; NEES and NIS: 1 is consistent", style="bold"),
        found.table(columns, header=True),
    ]
    for method, own in shown:
        parts.append(Text(f"{method} ({len(_by_method(score)[method])})"))
        for _, node in own:
            row = found.table(columns, [rows[node.name]], header=False)
            parts += _with_remark(row, told[node.name], found.width if beside else 0)
    return Group(*parts, *found.note())


def _with_remark(row: Table, remark: str, taken: int) -> list[RenderableType]:
    """Return a row with its remark beside it, after what is taken, or in lines of its own."""
    if not remark:
        return [row]
    if not taken:
        return [row, Padding(Text(remark), (0, 0, 0, 4))]
    line = Table.grid(padding=(0, GAP, 0, 0))
    line.add_column(width=taken)
    line.add_column(overflow="fold")
    line.add_row(row, remark)
    return [line]


def _by_method(score: Score) -> dict[str, list[NodeScore]]:
    methods: dict[str, list[NodeScore]] = {}
    for node in score.nodes:
        methods.setdefault(node.method, []).append(node)
    return methods


def _estimator_row(node: NodeScore, groups: Sequence[str]) -> list[str]:
    figures = [_figure(node.groups[group].rmse) for group in groups]
    return [f"  {node.name}", *figures, _per_dof(node.nees), _per_dof(node.nis)]


def attack_table(score: Score, width: int) -> Group | None:
    """Return what the detectors made of each attack, or None when no attacked packet was delivered."""
    if not score.windows:
        return None
    columns = [
        Column("attacked link", words=True),
        Column("by", leave_out=2, words=True, folds_to=8),
        Column("steps", leave_out=1),
        Column("rejected"),
        Column("false alarms", leave_out=3),
        Column("alarm after"),
        Column("trusted after", leave_out=4),
    ]
    links = {link.name: link for link in score.links}
    rows = [
        [
            window.link,
            window.stage.removesuffix(f"@{window.link}"),
            f"{window.first}..{window.last}",
            rejected(window),
            false_alarms(links[window.link].detector),
            alarm_after(window),
            trusted_after(window, score),
        ]
        for window in score.windows[:WINDOW_ROWS]
    ]
    return fitted(columns, rows, width, len(score.windows) - WINDOW_ROWS)


def _steps(value: float) -> str:
    if math.isnan(value):
        return "-"
    return "never" if math.isinf(value) else f"{value:.0f} steps"


def signal_table(score: Score, width: int) -> Group | None:
    """Return what the estimators knew of signal attacks, or None when none of them says anything."""
    speaking = [node for node in score.nodes if node.attack is not None]
    if not speaking:
        return None
    names = ("r during", "r else", "false alarms", "missed", "found after", "cleared after", "error")
    leave_out = (0, 5, 3, 2, 0, 6, 4)
    columns = [Column("signal attack", words=True), *map(Column, names, leave_out)]
    rows = [_signal_row(score, node, node.attack) for node in speaking[:SIGNAL_ROWS] if node.attack]
    return fitted(columns, rows, width, len(speaking) - SIGNAL_ROWS)


def _signal_row(score: Score, node: NodeScore, found: AttackScore) -> list[str]:
    return [
        node.name,
        _figure(found.probability_on),
        _figure(found.probability_off),
        "-" if found.false_alarms is None else str(found.false_alarms),
        "-" if found.misses is None else str(found.misses),
        *(_steps(node_value(score, node, f"attack.{name}_delay")) for name in ("detection", "release")),
        _figure(found.rmse),
    ]
