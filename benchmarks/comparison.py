"""What a benchmark finds: a figure of ours beside another one, and whether their ratio is as wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True)
class Wanted:
    """A bound on a ratio: at least, or at most."""

    bound: float
    at_least: bool = True

    def met_by(self, ratio: float) -> bool:
        """Return whether a ratio keeps the bound."""
        return ratio >= self.bound if self.at_least else ratio <= self.bound

    def __str__(self) -> str:
        return f"{'≥' if self.at_least else '≤'} {self.bound:g}"


def at_least(bound: float) -> Wanted:
    """Return the wish that a ratio is no less."""
    return Wanted(bound)


def at_most(bound: float) -> Wanted:
    """Return the wish that a ratio is no more."""
    return Wanted(bound, at_least=False)


@dataclass(frozen=True)
class Comparison:
    """One row of the table.

    ``samples`` and ``other_samples`` hold one figure a repetition, in ``unit``. ``note`` says why something
    was not measured. Without ``other`` the row only informs.
    """

    row: str
    what: str
    unit: str
    samples: Sequence[float]
    other: str = ""
    other_samples: Sequence[float] = ()
    wanted: Wanted | None = None
    note: str = ""

    @property
    def figure(self) -> float | None:
        """The median of ours."""
        return median(self.samples) if self.samples else None

    @property
    def other_figure(self) -> float | None:
        """The median of what it is compared with."""
        return median(self.other_samples) if self.other_samples else None

    @property
    def ratio(self) -> float | None:
        """The ratio of the medians."""
        if self.figure is None or not self.other_figure:
            return None
        return self.figure / self.other_figure

    @property
    def met(self) -> bool | None:
        """Whether the ratio is as wanted; None when nothing is wanted, or nothing was measured."""
        return None if self.wanted is None or self.ratio is None else self.wanted.met_by(self.ratio)

    def facts(self) -> dict[str, object]:
        """Return the row as plain data, ready for JSON."""
        return {
            "row": self.row,
            "what": self.what,
            "unit": self.unit,
            "median": self.figure,
            "samples": list(self.samples),
            "other": self.other or None,
            "other_median": self.other_figure,
            "other_samples": list(self.other_samples),
            "ratio": self.ratio,
            "wanted": str(self.wanted) if self.wanted else None,
            "met": self.met,
            "note": self.note or None,
        }
