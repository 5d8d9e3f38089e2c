"""``extends``: a file's mappings merge into its base's, node by node."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from orchestrator.topology.document import Entry, read_document, shown
from orchestrator.topology.names import NodeNameError, expand
from orchestrator.topology.problems import PathKeys, Problems

NODE_SECTIONS = ("sensors", "estimators", "controllers")
KIND_KEYS = {"plant": "model", "sensors": "model", "estimators": "method", "controllers": "law"}
GRAPH_OPTIONS = ("directed", "weights")

_KEPT_WITH_NEW_KIND = ("sensors", "estimator", "send")
_NOT_INHERITED = ("name", "description", "extends")
_PRUNED_SECTIONS = (
    *NODE_SECTIONS,
    "graph",
    "channel",
    "integrity",
    "adversary",
    "expect",
    "score",
    "process",
)


def read_with_bases(path: Path, problems: Problems) -> Entry | None:
    """Return a file merged over all its bases, with groups expanded; None when nothing can be read."""
    return _read(path.resolve(), (), problems)


def _read(path: Path, below: tuple[Path, ...], problems: Problems) -> Entry | None:
    entry = read_document(path, problems)
    if entry is None:
        return None
    own = expanded(entry, problems)
    named = own.mapping.get("extends")
    if named is None or named.value is None:
        return own
    if not isinstance(named.value, str):
        problems.add(named.origin, "extends", "is not the path of a file", "write 'extends: base.yaml'")
        return own
    base_path = (path.parent / named.value).resolve()
    if base_path in (*below, path):
        circle = " -> ".join(shown(file) for file in (*below, path, base_path))
        problems.add(
            named.origin, "extends", f"files extend each other in a circle: {circle}", "break the circle"
        )
        return own
    if not base_path.is_file():
        siblings = ", ".join(file.name for file in sorted(base_path.parent.glob("*.yaml"))) or "no YAML file"
        problems.add(
            named.origin, "extends", f"there is no file '{named.value}'", f"that folder has: {siblings}"
        )
        return own
    base = _read(base_path, (*below, path), problems)
    if base is None:
        return own
    return merge(_without(base, _NOT_INHERITED), own, ())


def _without(entry: Entry, keys: tuple[str, ...]) -> Entry:
    return Entry({key: member for key, member in entry.mapping.items() if key not in keys}, entry.origin)


def expanded(root: Entry, problems: Problems) -> Entry:
    """Return the file with every group of nodes written out, node by node."""
    members = dict(root.mapping)
    for section in NODE_SECTIONS:
        groups = members.get(section)
        if groups is not None and isinstance(groups.value, Mapping):
            members[section] = Entry(_expanded_groups(section, groups.value, problems), groups.origin)
    return Entry(members, root.origin)


def _expanded_groups(section: str, groups: Mapping[str, Entry], problems: Problems) -> dict[str, Entry]:
    nodes: dict[str, Entry] = {}
    owner: dict[str, str] = {}
    for key, group in groups.items():
        try:
            names = expand(key)
        except NodeNameError as problem:
            problems.add(group.origin, (section, key), str(problem), problem.cure)
            continue
        twice = [name for name in names if name in nodes]
        if twice:
            other = owner[twice[0]]
            line = nodes[twice[0]].origin.line
            problems.add(
                group.origin,
                (section, key),
                f"'{key}' and '{other}' (line {line}) both hold {twice[0]}",
                "let each node stand in one group",
            )
        for name in names:
            nodes.setdefault(name, group)
            owner.setdefault(name, key)
    return nodes


def merge(base: Entry, own: Entry, path: PathKeys) -> Entry:
    """Return ``own`` laid over ``base``: mappings merge deeply; lists, scalars and stages replace."""
    if not isinstance(base.value, Mapping) or not isinstance(own.value, Mapping):
        return own
    if len(path) == 2 and path[0] == "channel":
        return own
    members = dict(_prepared(base.value, own.value, path))
    for key, member in own.value.items():
        members[key] = merge(members[key], member, (*path, key)) if key in members else member
    return Entry(members, own.origin)


def _prepared(base: Mapping[str, Entry], own: Mapping[str, Entry], path: PathKeys) -> Mapping[str, Entry]:
    """Return what is left of a base's mapping when the mapping over it names another kind."""
    if path == ("graph",):
        kinds = own.keys() - set(GRAPH_OPTIONS)
        return base if kinds <= base.keys() else {}
    if len(path) == 3 and path[0] in NODE_SECTIONS and path[2] == "send":
        return base if own.keys() <= base.keys() else {}
    kind_key = kind_key_at(path)
    if kind_key is None or kind_key not in own or kind_key not in base:
        return base
    if own[kind_key].value == base[kind_key].value:
        return base
    return keep_with_new_kind(base)


def kind_key_at(path: PathKeys) -> str | None:
    """Return the key that names the kind in the mapping at a path, None where there is no kind."""
    depth = 2 if path and path[0] in NODE_SECTIONS else 1
    return KIND_KEYS.get(str(path[0])) if len(path) == depth else None


def keep_with_new_kind(members: Mapping[str, Entry]) -> dict[str, Entry]:
    """Return what stays of a node when its kind changes: parameters belong to their kind."""
    return {key: member for key, member in members.items() if key in _KEPT_WITH_NEW_KIND}


def pruned(root: Entry) -> Entry:
    """Return the topology without the members that ``null`` takes away.

    Parameters keep their nulls: for a parameter that may be null it is a value.
    """
    members = {}
    for key, member in root.mapping.items():
        if member.value is None:
            continue
        if key in _PRUNED_SECTIONS and isinstance(member.value, Mapping):
            kept = {name: inner for name, inner in member.value.items() if inner.value is not None}
            members[key] = Entry(kept, member.origin)
        else:
            members[key] = member
    return Entry(members, root.origin)
