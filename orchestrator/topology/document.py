"""YAML with a place for every value: duplicate keys, tags and foreign types are refused."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from orchestrator.topology.problems import Origin, PathKeys, Problems, did_you_mean

Scalar = str | int | float | bool | None

LARGEST_INTEGER = 2**53

_TAG = "tag:yaml.org,2002:"


@dataclass(frozen=True)
class Entry:
    """A value and where it was written. A member of a mapping has the place of its key."""

    value: Mapping[str, Entry] | tuple[Entry, ...] | Scalar
    origin: Origin

    @property
    def mapping(self) -> Mapping[str, Entry]:
        """The members of a mapping; empty for anything else."""
        return self.value if isinstance(self.value, Mapping) else {}

    def plain(self) -> Any:
        """Return the value as plain Python data."""
        if isinstance(self.value, Mapping):
            return {key: entry.plain() for key, entry in self.value.items()}
        if isinstance(self.value, tuple):
            return [entry.plain() for entry in self.value]
        return self.value

    def nearest(self, path: PathKeys) -> tuple[Entry, PathKeys]:
        """Return the deepest entry on a path, and the part of the path that exists.

        A key that does not exist is skipped: validators add the names of union members to their paths.
        """
        entry, found = self, []
        for key in path:
            if isinstance(entry.value, Mapping) and key in entry.value:
                entry = entry.value[str(key)]
            elif isinstance(entry.value, tuple) and isinstance(key, int) and key < len(entry.value):
                entry = entry.value[key]
            else:
                continue
            found.append(key)
        return entry, tuple(found)


class _Reader:
    """Turns composed YAML nodes into entries and notes what a topology cannot hold."""

    def __init__(self, yaml: YAML, place: Origin, one_place: bool, problems: Problems) -> None:
        self._yaml = yaml
        self._place = place
        self._one_place = one_place
        self._problems = problems
        self._open: set[int] = set()

    def _origin(self, node: Node) -> Origin:
        if self._one_place:
            return self._place
        return Origin(self._place.file, node.start_mark.line + 1, self._place.directory)

    def read(self, node: Node, origin: Origin, path: PathKeys) -> Entry:
        """Return the entry of a node; ``origin`` is where its key or list item stands."""
        if id(node) in self._open:
            self._problems.add(origin, path, "an alias contains itself", "write it out")
            return Entry(None, origin)
        self._open.add(id(node))
        try:
            if isinstance(node, MappingNode):
                return Entry(self._members(node, path), origin)
            if isinstance(node, SequenceNode):
                items = (self.read(item, self._origin(item), (*path, i)) for i, item in enumerate(node.value))
                return Entry(tuple(items), origin)
            assert isinstance(node, ScalarNode)
            return Entry(self._scalar(node, origin, path), origin)
        finally:
            self._open.discard(id(node))

    def _members(self, node: MappingNode, path: PathKeys) -> dict[str, Entry]:
        members: dict[str, Entry] = {}
        for key_node, value_node in node.value:
            origin = self._origin(key_node)
            key = key_node.value
            if not isinstance(key_node, ScalarNode) or str(key_node.tag) != f"{_TAG}str":
                self._problems.add(origin, path, f"the key '{key}' is not text", "put it in quotes")
            elif key in members:
                first = members[key].origin.line
                self._problems.add(
                    origin, (*path, key), f"the key '{key}' is there twice, first in line {first}", "keep one"
                )
            else:
                members[key] = self.read(value_node, origin, (*path, key))
        return members

    def _scalar(self, node: ScalarNode, origin: Origin, path: PathKeys) -> Scalar:
        tag = str(node.tag)
        if tag in {f"{_TAG}str", f"{_TAG}timestamp"}:
            return str(node.value)
        if tag not in {f"{_TAG}int", f"{_TAG}float", f"{_TAG}bool", f"{_TAG}null"}:
            self._problems.add(origin, path, f"the tag {tag} is not allowed", "write plain text")
            return None
        value: Scalar = self._yaml.constructor.construct_object(node)
        if isinstance(value, float) and not math.isfinite(value):
            self._problems.add(origin, path, f"{node.value} is not a finite number", "give a finite number")
            return None
        if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
            self._problems.add(
                origin, path, f"{value} is beyond 2^53", "JSON holds whole numbers up to there"
            )
            return None
        return value


def _cure_of_syntax(text: str, message: str, line: int) -> str:
    lines = text.splitlines()
    written = lines[line - 1] if 0 < line <= len(lines) else ""
    if "\\t" in message:
        return "indent with spaces, not with tabs"
    if "alias" in message or "%" in message or "@" in message:
        return 'put text that begins with a special character in quotes, for example "*->e4"'
    if written.count(":") > 1:
        return "put text that contains ': ' in quotes"
    return "check the brackets, quotes and indentation of this line and the one before"


def parse(text: str, file: str, directory: Path, problems: Problems, line: int | None = None) -> Entry | None:
    """Return the entries of a YAML text, None when it is empty or cannot be read (noted in ``problems``).

    With ``line`` given, every value is said to stand there: for text that does not come from a file.
    """
    yaml = YAML(typ="safe", pure=True)
    place = Origin(file, 1 if line is None else line, directory)
    try:
        node = yaml.compose(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        at = place if line is not None or mark is None else Origin(file, mark.line + 1, directory)
        message = ", ".join(part for part in (error.context, error.problem) if part)
        problems.add(at, "", f"not YAML: {message}", _cure_of_syntax(text, message, at.line))
        return None
    except YAMLError as error:
        problems.add(place, "", f"not YAML: {str(error).splitlines()[0]}", "save the file as UTF-8 text")
        return None
    if node is None:
        return None
    return _Reader(yaml, place, line is not None, problems).read(node, place, ())


def shown(path: Path) -> str:
    """Return a path as messages show it: relative when it lies below the current directory."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def read_document(path: Path, problems: Problems) -> Entry | None:
    """Return the mapping that a file holds, None when it holds none (noted in ``problems``)."""
    place = Origin(shown(path), 0, path.parent)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        problems.add(place, "", "there is no such file", _neighbouring_files(path))
        return None
    except IsADirectoryError:
        problems.add(place, "", "is a folder", "name a file in it; 'gauntlet test' takes folders")
        return None
    except (OSError, UnicodeDecodeError) as error:
        problems.add(place, "", f"cannot be read: {error}", "give a UTF-8 text file")
        return None
    before = len(problems)
    entry = parse(text, place.file, path.parent, problems)
    if entry is None or entry.value is None:
        if len(problems) == before:
            problems.add(place, "", "the file is empty", "begin with 'extends: base.yaml' or 'steps: 150'")
        return None
    if not isinstance(entry.value, Mapping):
        problems.add(entry.origin, "", "the file is not a mapping", "write lines such as 'steps: 150'")
        return None
    return entry


def _neighbouring_files(path: Path) -> str:
    files = [str(file.relative_to(path.parent)) for file in sorted(path.parent.glob("*.yaml"))]
    return did_you_mean(path.name, files) or f"there is no YAML file in {path.parent}"
