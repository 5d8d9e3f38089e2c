"""The grid of a campaign: what each ``--set`` with several values makes of one topology."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from orchestrator.errors import InputError
from orchestrator.topology.value_lists import split_values

MOST_VARIANTS = 10_000
ATTACKS, AS_GIVEN, NONE = "attacks", "as given", "null"
"""The path that sets twins apart, with its value for a variant and for its unattacked twin."""


class GridError(InputError):
    """The grid cannot be laid out; the text names the override and the cure."""


@dataclass(frozen=True)
class Variant:
    """One cell of the grid.

    Parameters
    ----------
    number
        Its place: the first ``--set`` with several values varies slowest.
    overrides
        All that is set, ``path=value``, in the order of the command line.
    settings
        The value of each path that has several, as it was written.
    """

    number: int
    overrides: tuple[str, ...]
    settings: Mapping[str, str]

    def __str__(self) -> str:
        """Return the settings as people write them."""
        return ", ".join(f"{path}={value}" for path, value in self.settings.items()) or "as it stands"


def lay_grid(overrides: Iterable[str], twins: bool = False) -> list[Variant]:
    """Return every variant; raises `GridError`.

    An override with one value holds for all of them, in its place among the others. With ``twins`` each
    variant is followed by its twin, the same without any attack.
    """
    axes: list[list[tuple[str, str | None]]] = []
    swept: set[str] = set()
    for override in overrides:
        path, separator, text = override.partition("=")
        path = path.strip()
        values = split_values(text) if separator else [text]
        if path == "trial":
            raise GridError(f"--set {override}: trials are no variants; give --trials and --first-trial")
        if len(values) == 1:
            if path in swept:
                raise GridError(f"--set {override}: this overrides all the values that {path} has before it")
            axes.append([(override, None)])
            continue
        _check(override, path, values, swept)
        swept.add(path)
        axes.append([(path, value) for value in values])
    if twins:
        if ATTACKS in swept:
            raise GridError(f"--twin: {ATTACKS} has several values already; one of them may be null instead")
        axes.append([(ATTACKS, AS_GIVEN), (ATTACKS, NONE)])
    _check_size(axes)
    return [_variant(number, cell) for number, cell in enumerate(itertools.product(*axes))]


def _check(override: str, path: str, values: Sequence[str], swept: Iterable[str]) -> None:
    if "" in values:
        raise GridError(f"--set {override}: a value is empty; write null, or '' for an empty text")
    if path in swept:
        raise GridError(f"--set {override}: {path} has several values already; give them all in one --set")
    twice = sorted({value for value in values if values.count(value) > 1})
    if twice:
        raise GridError(f"--set {override}: the value {twice[0]} is there twice; keep one")


def _check_size(axes: Sequence[Sequence[object]]) -> None:
    size = 1
    for axis in axes:
        size *= len(axis)
    if size > MOST_VARIANTS:
        raise GridError(f"the grid has {size} variants; the limit is {MOST_VARIANTS}, so give fewer values")


def _variant(number: int, cell: Iterable[tuple[str, str | None]]) -> Variant:
    chosen = list(cell)
    return Variant(
        number,
        tuple(
            path if value is None else f"{path}={value}"
            for path, value in chosen
            if (path, value) != (ATTACKS, AS_GIVEN)
        ),
        {path: value for path, value in chosen if value is not None},
    )
