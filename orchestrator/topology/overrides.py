"""``--set path=value``: changes to a topology from the command line."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from orchestrator.topology.document import Entry, parse
from orchestrator.topology.inheritance import NODE_SECTIONS, expanded, keep_with_new_kind, kind_key_at
from orchestrator.topology.names import NodeNameError, expand, select
from orchestrator.topology.problems import Origin, PathKeys, Problems, did_you_mean, spell

_BETWEEN_KEYS = re.compile(r"(?<!\.)\.(?!\.)")
_ANY = "..."
_ANY_PATH = re.compile(r"(?<!\.)\.\.\.(?!\.)")
_INDEX = re.compile(r"\[(\d+)\]")
_SHORTHANDS = {"method": ("estimators", "*", "method")}
"""Keys that a topology does not have at its top, and the only thing that they can mean there."""
_EXPECTATION_KEYS = frozenset({"node", "link", "at_most", "at_least", "equals"})


class _OverrideError(Exception):
    """An override cannot be applied: what is wrong, and the cure."""


def apply_overrides(root: Entry, overrides: Iterable[str], problems: Problems) -> Entry:
    """Return the topology with every ``path=value`` applied in turn; what cannot be applied is noted."""
    for override in overrides:
        origin = Origin(f"--set {override}", 0, Path.cwd())
        path, separator, text = override.partition("=")
        if not separator or not path.strip():
            problems.add(
                origin, "", "is not of the form path=value", "for example: --set attacks[0].bias.value=20"
            )
            continue
        before = len(problems)
        value = parse(text, origin.file, origin.directory, problems, line=0)
        if len(problems) > before:
            continue
        try:
            changed = _assigned(root, (), _tokens(path.strip()), value or Entry(None, origin))
            root = expanded(changed, problems)
        except _OverrideError as refusal:
            problems.add(origin, path.strip(), *refusal.args)
    return root


def _tokens(path: str) -> tuple[str, ...]:
    """Return the keys of a path; `_ANY` stands where any keys may lie between."""
    if path in _SHORTHANDS:
        return _SHORTHANDS[path]
    parts = _ANY_PATH.split(_INDEX.sub(r".\1", path))
    tokens: list[str] = []
    for number, part in enumerate(parts):
        tokens += [_ANY] if number else []
        tokens += _BETWEEN_KEYS.split(part) if part or len(parts) == 1 else []
    return tuple(tokens)


def _assigned(entry: Entry, path: PathKeys, tokens: tuple[str, ...], value: Entry) -> Entry:
    """Return a copy of ``entry`` in which the member that ``tokens`` lead to is ``value``."""
    if not tokens:
        return value
    if tokens[0] == _ANY:
        return _assigned_below(entry, path, tokens[1:], value)
    if isinstance(entry.value, tuple):
        return _assigned_item(entry, entry.value, path, tokens, value)
    if entry.value is not None and not isinstance(entry.value, Mapping):
        raise _OverrideError("leads into a value that has no members", "set the value itself")
    members = dict(entry.mapping)
    keys, rest = _keys(members, path, tokens)
    kind_key = kind_key_at(path)
    for key in keys:
        if not rest and key == kind_key and key in members and members[key].value != value.value:
            members = keep_with_new_kind(members)
        old = members.get(key, Entry(None, value.origin))
        members[key] = _assigned(old, (*path, key), rest, value)
    return Entry(members, entry.origin)


def _assigned_below(entry: Entry, path: PathKeys, tokens: tuple[str, ...], value: Entry) -> Entry:
    """Return a copy of ``entry`` in which the tokens are followed from every place below that has the first.

    Below a key that was found nothing else is looked for.
    """
    if not tokens or tokens[0] == _ANY:
        raise _OverrideError("'...' does not say what it leads to", "for example: channel...failure=0.1")
    found = 0

    def descended(here: Entry, at: PathKeys) -> Entry:
        nonlocal found
        if tokens[0] in here.mapping:
            found += 1
            return _assigned(here, at, tokens, value)
        if isinstance(here.value, tuple):
            return Entry(tuple(descended(item, (*at, i)) for i, item in enumerate(here.value)), here.origin)
        if isinstance(here.value, Mapping):
            return Entry({key: descended(own, (*at, key)) for key, own in here.value.items()}, here.origin)
        return here

    changed = descended(entry, path)
    if not found:
        where = f"below {spell(path)}" if path else "anywhere"
        cure = "'...' finds what the files state; write out the path of a key that they leave out"
        raise _OverrideError(f"no '{tokens[0]}' stands {where}", cure)
    return changed


def _assigned_item(
    entry: Entry, items: tuple[Entry, ...], path: PathKeys, tokens: tuple[str, ...], value: Entry
) -> Entry:
    if not tokens[0].isdigit() or int(tokens[0]) >= len(items):
        raise _OverrideError(
            f"the list has no item '{tokens[0]}'", f"its items are [0] to [{len(items) - 1}]"
        )
    index = int(tokens[0])
    changed = _assigned(items[index], (*path, index), tokens[1:], value)
    return Entry((*items[:index], changed, *items[index + 1 :]), entry.origin)


def _keys(
    members: Mapping[str, Entry], path: PathKeys, tokens: tuple[str, ...]
) -> tuple[list[str], tuple[str, ...]]:
    """Return the members that the first tokens name, and the tokens that are left.

    Keys may hold dots (``rmse.position``): the longest existing key wins.
    """
    for count in range(len(tokens), 0, -1):
        key = ".".join(tokens[:count])
        if key in members:
            return [key], tokens[count:]
    chooser = _CHOOSERS.get(str(path[0])) if len(path) == 1 else None
    if chooser is not None:
        return chooser(members, path, tokens)
    return [tokens[0]], tokens[1:]


def _nodes(
    members: Mapping[str, Entry], path: PathKeys, tokens: tuple[str, ...]
) -> tuple[list[str], tuple[str, ...]]:
    chosen = select(tokens[0], members)
    if chosen:
        return chosen, tokens[1:]
    if len(tokens) > 1:
        raise _OverrideError(
            f"there is no node '{tokens[0]}' among the {path[0]}", did_you_mean(tokens[0], members)
        )
    try:
        return expand(tokens[0]), ()
    except NodeNameError as problem:
        raise _OverrideError(str(problem), problem.cure) from None


def _metrics(
    members: Mapping[str, Entry], path: PathKeys, tokens: tuple[str, ...]
) -> tuple[list[str], tuple[str, ...]]:
    if len(tokens) > 1 and tokens[-1] in _EXPECTATION_KEYS:
        return [".".join(tokens[:-1])], tokens[-1:]
    return [".".join(tokens)], ()


def _patterns(
    members: Mapping[str, Entry], path: PathKeys, tokens: tuple[str, ...]
) -> tuple[list[str], tuple[str, ...]]:
    if len(tokens) > 1:
        raise _OverrideError(f"there is no channel '{tokens[0]}'", did_you_mean(tokens[0], members))
    return [tokens[0]], ()


_Chooser = Callable[[Mapping[str, Entry], PathKeys, tuple[str, ...]], tuple[list[str], tuple[str, ...]]]
_CHOOSERS: dict[str, _Chooser] = {
    **dict.fromkeys(NODE_SECTIONS, _nodes),
    "expect": _metrics,
    "channel": _patterns,
}
