"""Whether a metric is of the same thing for all who are compared: what each of them ran, side by side.

Attacks, channels, sensors and methods are what people compare. The plant, the length of a step and of a run,
and how errors are counted are the ground that they stand on: where that differs, so may every figure.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from orchestrator.evidence.metrics import meaning_of
from orchestrator.registry import portable_name

Document = Mapping[str, Any]
"""A resolved topology as plain data."""

_GROUND = {
    "plant": ("they ran different plants", "a difference in errors may be the plants', not the estimators'"),
    "period_s": ("a step is not as long", "what is counted or averaged by steps is not of the same time"),
    "steps": ("their runs are not as long", "averages, peaks and counts are not of the same time"),
    "score": ("they are not scored alike", "the same errors would give other figures"),
}
"""By key of a topology: what it means that two differ there, and what follows."""

_KEPT = frozenset({"score.node_series"})
"""What differs in what is kept, and in no figure."""

_TOGETHER = {"sum": "adds up", "max": "is the largest of"}
_PATHS, _NAMES, _LETTERS = 3, 3, 40


def ground(settings: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """Return those settings of a variant, by path, that may change the ground that it stands on."""
    return tuple(
        (path, value)
        for path, value in settings.items()
        if re.split(r"[.\[]", path)[0] in (*_GROUND, "extends", "")
    )


def different_ground(names: Sequence[str], documents: Sequence[Document]) -> list[str]:
    """Return in a sentence for each part of the ground in what these topologies differ, and what follows."""
    told = []
    for key, (what, then) in _GROUND.items():
        differing = list(_differing(names, [document.get(key) for document in documents], key))
        if differing:
            more = f", and {len(differing) - _PATHS} more" if len(differing) > _PATHS else ""
            told.append(f"{what} ({'; '.join(differing[:_PATHS])}{more}): {then}")
    return told


def different_numbers(names: Sequence[str], numbers: Sequence[int], metrics: Sequence[str]) -> list[str]:
    """Return in a sentence each metric that grows with how many estimators make it, where these differ."""
    counted = [(name, number) for name, number in zip(names, numbers, strict=True) if number]
    if len({number for _, number in counted}) < 2:
        return []
    whose = _by_value([(name, str(number)) for name, number in counted])
    return [
        f"{metric} {_TOGETHER[together]} the estimators of each, which are not as many: {whose}"
        for metric in metrics
        if (together := meaning_of(metric).together) in _TOGETHER
    ]


def _differing(names: Sequence[str], values: Sequence[Any], key: str) -> Iterator[str]:
    """Yield each path below a key in which those differ that have it, and who has which value."""
    leaves = [dict(_leaves(value, key)) for value in values]
    model = f"{key}.model"
    paths = dict.fromkeys(path for own in leaves for path in own)
    if len({own.get(model) for own in leaves}) > 1:
        paths = {model: None}  # the parameters of other models are others
    for path in paths:
        held = [(name, own[path]) for name, own in zip(names, leaves, strict=True) if path in own]
        if path not in _KEPT and len({value for _, value in held}) > 1:
            key = path.rpartition(".")[2]
            is_named = all(f"{path}=" in name or f"{key} " in name for name, _ in held)
            yield f"{path} differs" if is_named else f"{path} is {_by_value(held)}"


def _leaves(value: Any, path: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, own in value.items():
            yield from _leaves(own, f"{path}.{key}")
    else:
        yield path, _spelt(value)


def _spelt(value: Any) -> str:
    """Return a value as text that is the same for the same thing: 1 is 1.0, a user's file is its content."""
    if isinstance(value, str):
        try:
            return portable_name(value)
        except OSError:
            return value
    return json.dumps(_with_integers(value))


def _with_integers(value: Any) -> Any:
    if isinstance(value, list):
        return [_with_integers(own) for own in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _by_value(held: Sequence[tuple[str, str]]) -> str:
    """Return each value with the names of those that have it."""
    whose: dict[str, list[str]] = {}
    for name, value in held:
        whose.setdefault(value, []).append(name)
    parts = [f"{_short(value)} for {_listed(own)}" for value, own in whose.items()]
    more = [f"and {len(parts) - _NAMES} other values"] if len(parts) > _NAMES + 1 else []
    return ", ".join([*parts[: _NAMES if more else None], *more])


def _short(text: str) -> str:
    return text if len(text) <= _LETTERS else f"{text[: _LETTERS - 3]}..."


def _listed(names: Sequence[str]) -> str:
    if len(names) > _NAMES:
        return f"{names[0]} and {len(names) - 1} more"
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
