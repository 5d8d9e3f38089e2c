"""The code that a plan runs and that no version of Gauntlet tells: a user's own, known by its content.

A class of a user's own may change between two sweeps, and so may what it imports. The imports that its source
states are followed from file to file, so what is known is a function of the code alone, whatever else this
process has loaded. What is imported under a computed name, and files that the code reads, are not seen.
"""

from __future__ import annotations

import ast
import importlib.util
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from importlib import metadata
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any, NamedTuple

from bus.kinds import content_hash, is_file_reference, load_class
from bus.plan import Kind, Plan
from orchestrator.log.provenance import DISTRIBUTIONS

_OWN = frozenset({"bus", "nodes", "channel", "orchestrator"})
_RELEASED = frozenset({"site-packages", "dist-packages"})
_HASH = "sha256-"


class _Source(NamedTuple):
    """A file of code: by what people know it, and the package that its relative imports begin in."""

    name: str
    file: Path
    package: str = ""


def code_of(plans: Iterable[Plan]) -> dict[str, str]:
    """Return what is known of the code of a user's own that plans run, by name.

    A module, or a file that a topology names (``my_filter.py``), has the hash of its content; several files
    of one name have all of theirs. A distribution that is installed, and not to be edited, has its version,
    unless campaigns note that anyhow. Raises `KindError` when a class cannot be loaded.
    """
    seen: set[Path] = set()
    hashes: dict[str, set[str]] = {}
    released: set[str] = set()
    references = set().union(*map(_references, plans))
    for reference in references:
        load_class(reference)  # which may lead to more places to import from
    left = [source for reference in sorted(references) for source in _named(reference, released)]
    while left:
        source = left.pop()
        if source.file in seen:
            continue
        seen.add(source.file)
        hashes.setdefault(source.name, set()).add(f"{_HASH}{content_hash(source.file)}")
        for name in _imports(source):
            left += _sources_of(name, released)
    versions = dict(_version(top) for top in released if top not in DISTRIBUTIONS)
    found = {name: " ".join(sorted(own)) for name, own in hashes.items()}
    return dict(sorted({**versions, **found}.items()))


def changed_code(held: Mapping[str, str], found: Mapping[str, str]) -> list[str]:
    """Return the names in ``found`` whose code is none of what is held of them.

    A part of a campaign's code, such as that of one variant, is unchanged where all of it is held.
    """
    return [name for name, own in found.items() if not set(own.split()) <= set(held.get(name, "").split())]


def _references(part: Any) -> set[str]:
    """Return the references of all kinds in a part of a plan."""
    if isinstance(part, Kind):
        return {part.reference}
    if isinstance(part, tuple):
        return set().union(*map(_references, part))
    if is_dataclass(part):
        return set().union(*(_references(getattr(part, own.name)) for own in fields(part)))
    return set()


def _named(reference: str, released: set[str]) -> list[_Source]:
    location = reference.rpartition(":")[0]
    if is_file_reference(reference):
        return [_Source(Path(location).name, Path(location))]
    return _sources_of(location, released)


def _sources_of(name: str, released: set[str]) -> list[_Source]:
    """Return the files that importing a module runs: its own, and those of the packages that it is in.

    Of an installed distribution there are none: its uppermost name is added to ``released``.
    """
    parts = name.split(".")
    if parts[0] in _OWN or parts[0] in sys.stdlib_module_names:
        return []
    found: list[_Source] = []
    for end in range(1, len(parts) + 1):
        own = ".".join(parts[:end])
        spec = _spec(own)
        if spec is None:
            break
        if spec.has_location and spec.origin is not None:
            file = Path(spec.origin)
            if _RELEASED & set(file.parts):
                released.add(parts[0])
                break
            is_package = spec.submodule_search_locations is not None
            found.append(_Source(own, file.resolve(), own if is_package else own.rpartition(".")[0]))
    return found


def _spec(name: str) -> ModuleSpec | None:
    """Return where a module comes from, None when there is none of that name: it may be that of a value."""
    try:
        return importlib.util.find_spec(name)
    except Exception:  # of a package above it, which is run when this is asked
        return None


def _imports(source: _Source) -> Iterator[str]:
    """Yield what a file may import, anywhere in it: modules, and what is taken from them."""
    try:
        tree = ast.parse(source.file.read_bytes())
    except (SyntaxError, ValueError):  # a compiled module, or one that nothing could import
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = _absolute(node, source.package)
            yield from (f"{base}.{alias.name}" for alias in node.names)


def _absolute(node: ast.ImportFrom, package: str) -> str:
    upper = package.split(".")[: 1 - node.level or None] if node.level else []
    return ".".join([*upper, *([node.module] if node.module else [])])


def _version(top: str) -> tuple[str, str]:
    """Return the distribution that an installed package is of, with its version."""
    try:
        return top, metadata.version(top)
    except metadata.PackageNotFoundError:
        names = metadata.packages_distributions().get(top, [])
        return top, " ".join(f"{name}-{metadata.version(name)}" for name in sorted(set(names))) or "unknown"
