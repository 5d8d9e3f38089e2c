"""The verdict's tables: the estimators, and the attacks that reached them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from orchestrator.score.measure import node_value
from orchestrator.score.remarks import alarm_after, false_alarms, rejected, remarks, trusted_after
from orchestrator.score.results import Consistency, NodeScore, Score

ATTACKED_ROWS = 4
"""Attacked estimators that get a row of their own, for each method; those with the largest errors."""

WINDOW_ROWS = 6

SIGNAL_ROWS = 8

GROUP_COLUMNS = 3


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


def _table(header: bool) -> Table:
    return Table(
        box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False, show_header=header
    )


def _method_table(score: Score, rows: Sequence[tuple[str, NodeScore]], header: bool, width: int) -> Table:
    """Return the rows of one method; tables of one score have columns of equal widths."""
    groups = _group_columns(score)
    table = _table(header)
    table.add_column("node", min_width=width, no_wrap=True)
    for name in (*groups, "NEES", "NIS"):
        table.add_column(name, justify="right", min_width=max(len(name), 5), no_wrap=True)
    table.add_column("")
    for rank, node in rows:
        figures = [_figure(node.groups[group].rmse) for group in groups]
        remark = ", ".join([*([rank] if rank else []), *remarks(node, score)])
        table.add_row(f"  {node.name}", *figures, _per_dof(node.nees), _per_dof(node.nis), remark)
    return table


def estimator_tables(score: Score) -> Group:
    """Return the estimators by method: RMSE by state group, NEES and NIS by degree of freedom."""
    methods: dict[str, list[NodeScore]] = {}
    for node in score.nodes:
        methods.setdefault(node.method, []).append(node)
    width = max([len("node"), *(len(node.name) + 2 for node in score.nodes)])
    parts: list[RenderableType] = [
        Text("RMSE by state group, ranked by the whole; NEES and NIS: 1 is consistent", style="bold"),
        _method_table(score, [], True, width),
    ]
    for method, nodes in methods.items():
        parts.append(Text(f"{method} ({len(nodes)})"))
        parts.append(_method_table(score, _rows(nodes), False, width))
    return Group(*parts)


def attack_table(score: Score) -> Table | None:
    """Return what the detectors made of each attack, or None when no attacked packet was delivered."""
    if not score.windows:
        return None
    table = _table(header=True)
    table.add_column("attacked link", no_wrap=True)
    table.add_column("by", overflow="ellipsis", no_wrap=True)
    for name in ("steps", "rejected", "false alarms", "alarm after", "trusted after"):
        table.add_column(name, justify="right")
    links = {link.name: link for link in score.links}
    for window in score.windows[:WINDOW_ROWS]:
        table.add_row(
            window.link,
            window.stage.removesuffix(f"@{window.link}"),
            f"{window.first}..{window.last}",
            rejected(window),
            false_alarms(links[window.link].detector),
            alarm_after(window),
            trusted_after(window, score),
        )
    if len(score.windows) > WINDOW_ROWS:
        table.add_row(f"and {len(score.windows) - WINDOW_ROWS} more")
    return table


def _steps(value: float) -> str:
    if math.isnan(value):
        return "-"
    return "never" if math.isinf(value) else f"{value:.0f} steps"


def signal_table(score: Score) -> Table | None:
    """Return what the estimators knew of signal attacks, or None when none of them says anything."""
    speaking = [node for node in score.nodes if node.attack is not None]
    if not speaking:
        return None
    table = _table(header=True)
    table.add_column("signal attack", no_wrap=True)
    for name in ("r during", "r else", "false alarms", "missed", "found after", "cleared after", "error"):
        table.add_column(name, justify="right")
    for node in speaking[:SIGNAL_ROWS]:
        found = node.attack
        assert found is not None
        table.add_row(
            node.name,
            _figure(found.probability_on),
            _figure(found.probability_off),
            "-" if found.false_alarms is None else str(found.false_alarms),
            "-" if found.misses is None else str(found.misses),
            *(_steps(node_value(score, node, f"attack.{name}_delay")) for name in ("detection", "release")),
            _figure(found.rmse),
        )
    if len(speaking) > SIGNAL_ROWS:
        table.add_row(f"and {len(speaking) - SIGNAL_ROWS} more")
    return table
