"""Who is compared: from what people name to rows.

A contender is a run, a campaign of one variant, or a part of a source: a variant, the estimators of one
method, or one estimator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from orchestrator.errors import InputError
from orchestrator.evidence.chosen import Chosen, shown, told_apart, variant_name
from orchestrator.evidence.columns import COMPLETE, MISSING, PRIVILEGED, Rows, select
from orchestrator.evidence.comparability import Document, ground
from orchestrator.evidence.metrics import is_measured_by_window
from orchestrator.evidence.sources import Source
from orchestrator.evidence.table import SWEPT
from orchestrator.topology.problems import did_you_mean

_KEYS = ("variant", "trial", "seed", "node", "method", "status", PRIVILEGED, COMPLETE, MISSING)


class ContenderError(InputError):
    """What was named cannot be compared; the text tells what can."""


@dataclass(frozen=True)
class Contender:
    """Somebody with a name, where the rows are that tell of them, and the resolved topology that they ran."""

    name: str
    path: str
    rows: Rows
    document: Document = field(default_factory=dict)


def find_contenders(chosen: Sequence[Chosen], by: str | None, metrics: Sequence[str]) -> list[Contender]:
    """Return who is compared.

    Parameters
    ----------
    chosen
        Runs and campaigns, or variants of these.
    by
        What to take apart each of them by: ``variant``, ``method``, ``node``, or a swept path.
    metrics
        What will be asked of them.

    Raises
    ------
    InputError
        A source cannot be read or is not one contender, or there are fewer than two.
    """
    found = [
        contender for own in chosen for contender in _contenders(own, by, metrics, alone=len(chosen) == 1)
    ]
    if len(found) < 2:
        raise ContenderError(
            f"{chosen[0].source.path} is one contender; name a second, or take it apart with --by node, "
            "method or variant"
        )
    names = told_apart([own.name for own in found], [own.path for own in found])
    return [replace(own, name=name) for own, name in zip(found, names, strict=True)]


def usual_metric(chosen: Sequence[Chosen]) -> str:
    """Return the metric to compare by when none is asked for."""
    has_position = all("rmse.position" in own.source.metrics for own in chosen)
    return "rmse.position" if has_position else "rmse.state"


def _contenders(chosen: Chosen, by: str | None, metrics: Sequence[str], *, alone: bool) -> list[Contender]:
    source, variants = chosen.source, chosen.variants
    _check_metrics(source, metrics)
    if by is None and alone and len(variants) > 1:
        by = "variant"
    path = str(source.path)
    if by not in ("node", "method", None):
        chosen.check_by(by)
        table = source.read(lambda name: _is_needed(name, metrics), variants)
        documents = _documents(chosen)
        return [
            Contender(
                variant_name(variant, settings), path, select(table, variant=variant), documents[variant]
            )
            for variant, settings in variants.items()
        ]
    _refuse_several(chosen, "as one contender" if by is None else f"with --by {by}")
    table = source.read(lambda name: _is_needed(name, metrics), variants)
    (document,) = _documents(chosen).values()
    if by is None:
        return [Contender(chosen.name, path, select(table), document)]
    names = dict.fromkeys(str(name) for name in table.column(by).to_pylist() if name)
    if not names:
        raise ContenderError(f"{source.path} cannot be taken apart by {by}: none of its trials was scored")
    rows = [
        (name, select(table, nodes=[name]) if by == "node" else select(table, methods=[name]))
        for name in names
    ]
    return [Contender(_marked(name, own), path, own, document) for name, own in rows]


def _documents(chosen: Chosen) -> dict[int, Document]:
    """Return the topology of each variant, or that of one that stands on the same ground.

    To read one takes a while, and of most campaigns one will do.
    """
    alike: dict[object, int] = {}
    return {
        variant: chosen.source.document(alike.setdefault(ground(settings), variant))
        for variant, settings in chosen.variants.items()
    }


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


def _refuse_several(chosen: Chosen, what: str) -> None:
    if len(chosen.variants) != 1:
        raise ContenderError(
            f"{chosen.source.path} has {len(chosen.variants)} variants and cannot be taken {what}; "
            f"name one as in '{chosen.source.path}#0' ({shown(chosen.variants)})"
        )


def _marked(name: str, rows: Rows) -> str:
    """Return a name that says so where an oracle tells every estimator that it stands for of the attacks."""
    return f"{name} PRIVILEGED" if set(rows.text("node")) <= set(rows.privileged) else name
