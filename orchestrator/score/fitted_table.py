"""Tables that fit a terminal's width: heads break and columns are left out, but no figure is ever cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

GAP = 2
"""Letters between two columns."""


@dataclass(frozen=True)
class Column:
    """A column: figures stand at its right, words at its left.

    Words may be folded to ``folds_to`` letters (0: not at all). ``leave_out`` says when the column gives way
    to the others: the one of the largest number first, one of 0 never.
    """

    name: str
    leave_out: int = 0
    words: bool = False
    folds_to: int = 0


@dataclass(frozen=True)
class Fit:
    """How columns fit: the indices of those kept, their widths and heads, and the names of the others."""

    kept: list[int]
    widths: list[int]
    heads: list[str]
    left_out: list[str]

    @property
    def width(self) -> int:
        """How wide the whole is."""
        return sum(self.widths) + GAP * (len(self.widths) - 1)

    def table(self, columns: Sequence[Column], rows: Sequence[Sequence[str]] = (), *, header: bool) -> Table:
        """Return a table of rows of cells, of which those in the columns kept are shown."""
        table = Table(
            box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False, show_header=header
        )
        for index, width, head in zip(self.kept, self.widths, self.heads, strict=True):
            left = columns[index].words
            table.add_column(head, justify="left" if left else "right", width=width, overflow="fold")
        for row in rows:
            table.add_row(*(row[index] for index in self.kept))
        return table

    def note(self) -> list[RenderableType]:
        """Return the line that says what was left out, if anything was."""
        if not self.left_out:
            return []
        return [Text(f"(no room for: {', '.join(self.left_out)})", style="dim")]


def fit(columns: Sequence[Column], rows: Sequence[Sequence[str]], width: int) -> Fit:
    """Return how a table fits: words fold first, then heads break at spaces, then columns are left out."""
    kept = list(range(len(columns)))
    while True:
        for broken in (False, True):
            heads = [columns[i].name.replace(" ", "\n") if broken else columns[i].name for i in kept]
            natural = [
                _widest([head, *(row[i] for row in rows)]) for i, head in zip(kept, heads, strict=True)
            ]
            room = width - GAP * (len(kept) - 1) - sum(natural)
            widths = _folded([columns[i] for i in kept], natural, -room)
            if widths is not None:
                return _fit(columns, kept, widths, heads)
        last = max(kept, key=lambda index: columns[index].leave_out)
        if columns[last].leave_out == 0:
            return _fit(columns, kept, natural, heads)
        kept.remove(last)


def _fit(columns: Sequence[Column], kept: list[int], widths: list[int], heads: list[str]) -> Fit:
    return Fit(kept, widths, heads, [own.name for i, own in enumerate(columns) if i not in kept])


def _widest(cells: Sequence[str]) -> int:
    return max(len(line) for cell in cells for line in cell.split("\n"))


def _folded(columns: Sequence[Column], natural: Sequence[int], missing: int) -> list[int] | None:
    """Return widths that are less by what is missing, at the cost of words; None where there are too few."""
    widths = list(natural)
    for index, column in enumerate(columns):
        if column.folds_to and missing > 0:
            spare = max(widths[index] - column.folds_to, 0)
            widths[index] -= min(spare, missing)
            missing -= spare
    return widths if missing <= 0 else None


def fitted(columns: Sequence[Column], rows: Sequence[Sequence[str]], width: int, more: int = 0) -> Group:
    """Return a table with its header, how many rows it does not show, and what was left out."""
    found = fit(columns, rows, width)
    rest = [Text(f"and {more} more")] if more > 0 else []
    return Group(found.table(columns, rows, header=True), *rest, *found.note())
