"""What people name on the command line: a run or a campaign, and which of its variants they mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from orchestrator.errors import InputError
from orchestrator.evidence.sources import Source, load_source
from orchestrator.evidence.table import SWEPT
from orchestrator.run_directory import LOG
from orchestrator.topology.value_lists import split_values

Settings = Mapping[str, str]
"""The value of each path that varies."""

_SHOWN = 8


class ChoiceError(InputError):
    """What was named is not there, or cannot be taken apart so; the text tells what can."""


@dataclass(frozen=True)
class Chosen:
    """A source and those of its variants that are meant, by number; ``choice`` is what names them, if any."""

    source: Source
    choice: str
    variants: Mapping[int, Settings]

    @property
    def name(self) -> str:
        """The name of the topology, with the choice."""
        return f"{self.source.name}#{self.choice}" if self.choice else self.source.name

    def check_by(self, by: str) -> None:
        """Raise `ChoiceError` unless the variants can be taken apart by ``variant`` or by a swept path.

        By a path they can where nothing else varies.
        """
        paths = next(iter(self.variants.values()), {})
        path = by.removeprefix(SWEPT)
        if by != "variant" and path not in paths:
            raise ChoiceError(
                f"--by {by}: {self.source.path} can be taken apart by node, method, variant"
                + "".join(f", {path}" for path in paths)
            )
        others = [other for other in paths if other != path]
        held = {tuple(own[other] for other in others) for own in self.variants.values()}
        if by != "variant" and len(held) > 1:
            raise ChoiceError(
                f"--by {by}: {self.source.path} varies {', '.join(others)} too; "
                f"fix it as in '{self.source.path}#{others[0]}=VALUE', or take it apart with --by variant"
            )


def choose(named: str | Path) -> Chosen:
    """Return what a path names: a run, a log or a campaign, or some variants of a campaign.

    ``PATH#2`` is the variant of that number, ``PATH#method=kalman,steps=50`` are those with these settings.

    Raises
    ------
    InputError
        There is no such source, it cannot be read, or it has no such variant.
    """
    text = str(named)
    path, separator, choice = text.rpartition("#")
    if not separator or Path(text).exists():
        source = load_source(text)
        return Chosen(source, "", source.variants)
    source = load_source(path)
    return Chosen(source, choice, _variants(source, choice))


def _variants(source: Source, choice: str) -> Mapping[int, Settings]:
    variants = source.variants
    if choice.isdigit():
        chosen = {number: own for number, own in variants.items() if number == int(choice)}
    else:
        wanted = dict(part.partition("=")[::2] for part in split_values(choice))
        chosen = {
            number: own
            for number, own in variants.items()
            if all(own.get(path) == value for path, value in wanted.items())
        }
    if not chosen:
        raise ChoiceError(f"{source.path} has no variant '{choice}'; it has {shown(variants)}")
    return chosen


def shown(variants: Mapping[int, Settings]) -> str:
    """Return the variants for people, the first of many."""
    told = [f"{number}: {variant_name(number, own)}" for number, own in list(variants.items())[:_SHOWN]]
    return "; ".join(told) + ("; ..." if len(variants) > _SHOWN else "")


def variant_name(number: int, settings: Settings) -> str:
    """Return a variant's settings for people."""
    return ", ".join(f"{path}={value}" for path, value in settings.items()) or f"variant {number}"


def told_apart(names: Sequence[str], paths: Sequence[str]) -> list[str]:
    """Return different names: equal ones have their paths beside them, or at last their number."""
    apart = [
        f"{name} ({_place(path)})" if names.count(name) > 1 else name
        for name, path in zip(names, paths, strict=True)
    ]
    return [name if apart.count(name) == 1 else f"{name} [{i}]" for i, name in enumerate(apart, start=1)]


def _place(path: str) -> str:
    own = Path(path)
    return own.parent.name if own.name == LOG else own.name
