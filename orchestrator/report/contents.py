"""What a page is made of: plain values, before they become HTML.

A figure is plain data in Plotly's own form, with two liberties that `orchestrator.report.payload` takes back:
arrays are NumPy arrays, and a colour may be a token of the palette (``$attack``, or ``$attack/20`` for one of
20 % opacity), so that one figure serves the light and the dark page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

Trace = dict[str, Any]
Layout = dict[str, Any]


@dataclass(frozen=True)
class View:
    """One state of a figure: its traces, and what its layout has beyond the figure's own."""

    traces: Sequence[Trace]
    layout: Layout = field(default_factory=dict)


@dataclass(frozen=True)
class Choice:
    """A list to choose from, above a figure: ``options`` are (value, text), ``initial`` is a value."""

    label: str
    options: Sequence[tuple[str, str]]
    initial: str


@dataclass(frozen=True)
class Figure:
    """An interactive figure.

    Parameters
    ----------
    name
        Its name on the page and as a picture's file: letters, digits and hyphens.
    title
        What it shows, in a few words.
    views
        By the values chosen, in the order of ``choices``; the one view of a figure without choices is at ().
    text
        What to see in it, and how to read it; also what is read out in its place.
    aspect
        Height over width, where the figure needs one; else ``height`` (pixels) is what it has at any width.
    """

    name: str
    title: str
    views: Mapping[tuple[str, ...], View]
    layout: Layout = field(default_factory=dict)
    choices: Sequence[Choice] = ()
    text: str = ""
    height: int = 360
    aspect: float | None = None

    @property
    def initial(self) -> View:
        """The view that is shown first."""
        return self.views[tuple(choice.initial for choice in self.choices)]


@dataclass(frozen=True)
class Table:
    """A table: ``rows`` of cells as they are to be read; the columns in ``words`` are no numbers.

    A cell may be a `Mark` or a `Link`. ``folded`` tables show their caption only, until they are opened.
    """

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    words: frozenset[int] = frozenset({0})
    folded: bool = False


@dataclass(frozen=True)
class Mark:
    """A cell that says good or bad by word and colour; ``tone`` is good, bad, warn or plain."""

    text: str
    tone: str


@dataclass(frozen=True)
class Link:
    """A cell that leads to another page; ``target`` is relative to this one."""

    text: str
    target: str


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str


Block = Figure | Table | Text
"""What a section is made of."""


@dataclass(frozen=True)
class Tile:
    """A figure to be seen first: its name, its value, and a remark."""

    name: str
    value: str
    remark: str = ""
    tone: str = "plain"


@dataclass(frozen=True)
class Section:
    """A part of the page under one heading; ``name`` is its anchor."""

    name: str
    title: str
    blocks: Sequence[Block]
    lead: str = ""


@dataclass(frozen=True)
class Page:
    """A whole page.

    ``word`` is the verdict's first word and ``tone`` its colour. ``warnings`` stand at the head and say what
    the figures must not be taken for; ``notes`` say what was thinned or left out.
    """

    title: str
    kind: str
    word: str
    tone: str
    headline: str
    facts: str
    tiles: Sequence[Tile]
    sections: Sequence[Section]
    notes: Sequence[str] = ()
    warnings: Sequence[str] = ()

    @property
    def figures(self) -> list[Figure]:
        """All figures, in the order of the page."""
        return [block for section in self.sections for block in section.blocks if isinstance(block, Figure)]
