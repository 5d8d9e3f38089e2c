"""From pydantic's errors to problems with a line, in the words of a topology."""

from __future__ import annotations

import dataclasses
import json
import typing
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from orchestrator.topology.document import Entry
from orchestrator.topology.problems import PathKeys, Problems, did_you_mean, spell

_UNKNOWN_KEY = frozenset({"extra_forbidden", "unexpected_keyword_argument"})
_MISSING_KEY = frozenset({"missing", "missing_argument", "missing_keyword_only_argument"})
_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "dataclass_type": "a mapping",
    "finite_number": "a finite number",
}
_BOUND = {
    "greater_than": ("gt", "more than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def complain(
    details: Sequence[ErrorDetails],
    root: Entry,
    path: PathKeys,
    model: type[BaseModel],
    owner: str,
    problems: Problems,
) -> None:
    """Note a validation's errors.

    Parameters
    ----------
    details
        What pydantic found in the entry at ``path``.
    root
        The whole topology, for lines.
    model
        The model that was filled, for suggestions.
    owner
        What the keys belong to, as messages name it: ``the topology``, ``sensor linear``.
    """
    located = [(_inside(root, path, detail), detail) for detail in details]
    groups = _grouped(located)
    misspelt = {
        (*place[:-1], near)
        for place, (detail, *_) in groups.items()
        if detail["type"] in _UNKNOWN_KEY
        for near in get_close_matches(str(place[-1]), _known_keys(model, detail), n=1)
    }
    for place, group in groups.items():
        if is_missing_key(group[0]) and place in misspelt:
            continue
        holder = _holder(place[len(path) : -1]) or owner
        for message, cure in _texts(group, model, holder):
            entry, _ = root.nearest(place)
            problems.add(entry.origin, place, message, cure)


def _holder(path: PathKeys) -> str:
    """Return what messages call the mapping at a path; nodes of a group share one name."""
    if len(path) == 2 and path[0] in ("sensors", "estimators", "controllers"):
        return f"each of the {path[0]}"
    return f"'{spell(path)}'" if path else ""


def is_missing_key(detail: ErrorDetails) -> bool:
    """Return whether an error says that a key is missing."""
    return detail["type"] in _MISSING_KEY


def _inside(root: Entry, path: PathKeys, detail: ErrorDetails) -> PathKeys:
    """Return the path of an error, without the names of union members that pydantic puts in."""
    entry, _ = root.nearest(path)
    if is_missing_key(detail):
        _, found = entry.nearest(detail["loc"][:-1])
        return (*path, *found, detail["loc"][-1])
    _, found = entry.nearest(detail["loc"])
    return (*path, *found)


def _grouped(located: Iterable[tuple[PathKeys, ErrorDetails]]) -> dict[PathKeys, list[ErrorDetails]]:
    """Group errors by place; of a union's errors only the deepest are of use."""
    groups: dict[PathKeys, list[ErrorDetails]] = {}
    for place, detail in located:
        groups.setdefault(place, []).append(detail)
    for place in list(groups):
        is_union = len(groups[place][0]["loc"]) > len(place)
        deeper = any(len(other) > len(place) and other[: len(place)] == place for other in groups)
        if is_union and deeper:
            del groups[place]
    return groups


def _texts(details: list[ErrorDetails], model: type[BaseModel], owner: str) -> Iterator[tuple[str, str]]:
    expected = [_EXPECTED.get(detail["type"]) for detail in details]
    if len(details) > 1 and all(expected):
        names = list(dict.fromkeys(name for name in expected if name))
        yield f"{_show(details[0]['input'])} is not {' or '.join(names)}", ""
        return
    for detail in details:
        yield _text(detail, model, owner)


def _text(detail: ErrorDetails, model: type[BaseModel], owner: str) -> tuple[str, str]:
    kind, key = detail["type"], str(detail["loc"][-1])
    context = detail.get("ctx", {})
    if kind in _UNKNOWN_KEY:
        known = _known_keys(model, detail)
        return f"{owner} has no key '{key}'", did_you_mean(key, known) if known else "take it out"
    if kind in _MISSING_KEY:
        return f"{owner} needs the key '{key}'", f"add '{key}: ...'"
    if kind in _EXPECTED:
        return f"{_show(detail['input'])} is not {_EXPECTED[kind]}", ""
    if kind in _BOUND:
        name, words = _BOUND[kind]
        return f"is {_show(detail['input'])}, must be {words} {_limit(context[name])}", ""
    if kind == "literal_error":
        choices = str(context["expected"]).replace(" or ", ", ").split(", ")
        cure = did_you_mean(str(detail["input"]), [choice.strip("'") for choice in choices])
        return f"{_show(detail['input'])} is not {context['expected']}", cure
    if kind == "string_pattern_mismatch":
        return f"{_show(detail['input'])} is not a name", "use letters, digits, '.', '_' and '-'"
    return detail["msg"].removeprefix("Value error, "), ""


def _limit(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:g}"


def _show(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _known_keys(model: type[BaseModel], detail: ErrorDetails) -> list[str]:
    """Return the keys that might have been meant by the unknown one of an error."""
    if len(detail["loc"]) == 1:
        return [field.alias or name for name, field in model.model_fields.items()]
    return _inner_keys(model, str(detail["loc"][0]))


def _inner_keys(model: type[BaseModel], key: str) -> list[str]:
    """Return every key that may stand somewhere below a key of a model."""
    hints = [f.annotation for name, f in model.model_fields.items() if (f.alias or name) == key]
    return list(dict.fromkeys(name for hint in hints for name in _names_inside(hint)))


def _names_inside(hint: Any) -> Iterator[str]:
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        for name, field in hint.model_fields.items():
            yield field.alias or name
            yield from _names_inside(field.annotation)
    elif isinstance(hint, type) and dataclasses.is_dataclass(hint):
        for name, inner in typing.get_type_hints(hint).items():
            yield name
            yield from _names_inside(inner)
    for part in typing.get_args(hint):
        yield from _names_inside(part)
