"""Who is compared: from what people name to rows.

A contender is a run, a campaign of one variant, or a part of a source: a variant, the estimators of one
method, or one estimator.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from orchestrator.errors import InputError
from orchestrator.evidence.columns import COMPLETE, PRIVILEGED, Rows, select
from orchestrator.evidence.metrics import is_measured_by_window
from orchestrator.evidence.sources import Source, load_source
from orchestrator.evidence.table import SWEPT, settings_by_variant
from orchestrator.topology.problems import did_you_mean

_KEYS = ("variant", "trial", "seed", "node", "method", "status", PRIVILEGED, COMPLETE)


class ContenderError(InputError):
    """What was named cannot be compared; the text tells what can."""


@dataclass(frozen=True)
class Contender:
    """Somebody with a name, and where the rows are that tell of them."""

    name: str
    path: str
    rows: Rows


def find_contenders(named: Sequence[str], by: str | None, metrics: Sequence[str]) -> list[Contender]:
    """Return who is compared.

    Parameters
    ----------
    named
        Paths of runs, logs and campaigns; ``PATH#2`` names a variant, ``PATH#method=kalman`` the variant
        with that setting.
    by
        What to take apart each source by: ``variant``, ``method``, ``node``, or a swept path.
    metrics
        What will be asked of them.

    Raises
    ------
    InputError
        A source cannot be read or is not one contender, or there are fewer than two.
    """
    sources = [_opened(text) for text in named]
    found = [
        contender
        for source, choice in sources
        for contender in _contenders(source, choice, by, metrics, alone=len(sources) == 1)
    ]
    if len(found) < 2:
        raise ContenderError(
            f"{named[0]} is one contender; name a second, or take it apart with --by node, method or variant"
        )
    return _told_apart(found)


def usual_metric(named: Sequence[str]) -> str:
    """Return the metric to compare by when none is asked for."""
    known = [_opened(text)[0].metrics for text in named]
    return "rmse.position" if all("rmse.position" in metrics for metrics in known) else "rmse.state"


@functools.cache
def _opened(text: str) -> tuple[Source, str]:
    """Return a source, and which part of it is meant."""
    path, separator, choice = text.rpartition("#")
    if not separator or Path(text).exists():
        return load_source(text), ""
    return load_source(path), choice


def _contenders(
    source: Source, choice: str, by: str | None, metrics: Sequence[str], *, alone: bool
) -> list[Contender]:
    _check_metrics(source, metrics)
    table = source.read(lambda name: _is_needed(name, metrics))
    variants = settings_by_variant(table)
    if choice:
        variants = _chosen(source, variants, choice)
    if by is None and alone and len(variants) > 1:
        by = "variant"
    path = str(source.path)
    if by in ("node", "method"):
        _refuse_several(source, variants, f"with --by {by}")
        (variant,) = variants
        names = dict.fromkeys(str(name) for name in table.column(by).to_pylist() if name)
        if not names:
            raise ContenderError(
                f"{source.path} cannot be taken apart by {by}: none of its trials was scored"
            )
        rows = [
            (name, select(table, variant=variant, **{"nodes" if by == "node" else "methods": [name]}))
            for name in names
        ]
        return [Contender(_marked(name, own), path, own) for name, own in rows]
    if by is None:
        _refuse_several(source, variants, "as one contender")
        (variant,) = variants
        return [Contender(_source_name(source, choice), path, select(table, variant=variant))]
    _check_by(source, by, variants)
    return [
        Contender(_variant_name(variant, settings), path, select(table, variant=variant))
        for variant, settings in variants.items()
    ]


def _check_metrics(source: Source, metrics: Sequence[str]) -> None:
    """Raise `ContenderError` for a metric that a source has no column for."""
    numbers = source.metrics
    for metric in metrics:
        if metric not in numbers and not is_measured_by_window(metric):
            cure = did_you_mean(metric, numbers) or f"there is {', '.join(numbers)}"
            raise ContenderError(f"{source.path} has no metric '{metric}'; {cure}")


def _is_needed(name: str, metrics: Sequence[str]) -> bool:
    windows = any(is_measured_by_window(metric) for metric in metrics)
    return (
        name in _KEYS
        or name in metrics
        or name.startswith(SWEPT)
        or (windows and name.startswith("window."))
        or (windows and name == "packet.link")
    )


def _chosen(source: Source, variants: dict[int, dict[str, str]], choice: str) -> dict[int, dict[str, str]]:
    """Return the variants that a number or settings name."""
    if choice.isdigit():
        chosen = {number: own for number, own in variants.items() if number == int(choice)}
    else:
        wanted = dict(part.partition("=")[::2] for part in choice.split(","))
        chosen = {
            number: own
            for number, own in variants.items()
            if all(own.get(path) == value for path, value in wanted.items())
        }
    if not chosen:
        raise ContenderError(f"{source.path} has no variant '{choice}'; it has {_shown(variants)}")
    return chosen


def _check_by(source: Source, by: str, variants: dict[int, dict[str, str]]) -> None:
    paths = next(iter(variants.values()), {})
    if by != "variant" and by.removeprefix(SWEPT) not in paths:
        raise ContenderError(
            f"--by {by}: {source.path} can be taken apart by node, method, variant"
            + "".join(f", {path}" for path in paths)
        )
    others = [path for path in paths if path != by.removeprefix(SWEPT)]
    held = {tuple(own[path] for path in others) for own in variants.values()}
    if by != "variant" and len(held) > 1:
        raise ContenderError(
            f"--by {by}: {source.path} varies {', '.join(others)} too; "
            f"fix it as in '{source.path}#{others[0]}=VALUE', or compare --by variant"
        )


def _refuse_several(source: Source, variants: dict[int, dict[str, str]], what: str) -> None:
    if len(variants) != 1:
        raise ContenderError(
            f"{source.path} has {len(variants)} variants and cannot be taken {what}; "
            f"name one as in '{source.path}#0' ({_shown(variants)})"
        )


def _shown(variants: dict[int, dict[str, str]]) -> str:
    shown = [f"{number}: {_variant_name(number, own)}" for number, own in list(variants.items())[:8]]
    return "; ".join(shown) + ("; ..." if len(variants) > 8 else "")


def _variant_name(number: int, settings: dict[str, str]) -> str:
    return ", ".join(f"{path}={value}" for path, value in settings.items()) or f"variant {number}"


def _source_name(source: Source, choice: str) -> str:
    return f"{source.name}#{choice}" if choice else source.name


def _marked(name: str, rows: Rows) -> str:
    """Return a name that says so where an oracle tells every estimator that it stands for of the attacks."""
    return f"{name} PRIVILEGED" if set(rows.text("node")) <= set(rows.privileged) else name


def _told_apart(found: Sequence[Contender]) -> list[Contender]:
    """Return contenders of different names: equal ones are known by their paths too."""
    names = [contender.name for contender in found]
    apart = [f"{own.name} ({_place(own.path)})" if names.count(own.name) > 1 else own.name for own in found]
    return [
        Contender(name if apart.count(name) == 1 else f"{name} [{i + 1}]", own.path, own.rows)
        for i, (name, own) in enumerate(zip(apart, found, strict=True))
    ]


def _place(path: str) -> str:
    own = Path(path)
    return own.parent.name if own.suffix == ".mcap" and own.name == "run.mcap" else own.name
