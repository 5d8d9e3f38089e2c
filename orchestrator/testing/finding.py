"""Finds the topology files that paths lead to, and passes over what a project keeps beside them."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Collection, Iterable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from orchestrator.errors import InputError
from orchestrator.run_directory import LOG, SCORE, TIMING, TOPOLOGY
from orchestrator.topology.document import read_document
from orchestrator.topology.load import is_base
from orchestrator.topology.problems import Problems

_ENDINGS = (".yaml", ".yml")
_CAMPAIGN = "campaign.json"
_PACKAGES = frozenset({"node_modules", "site-packages", "__pycache__"})
_ENVIRONMENT = ("pyvenv.cfg", "conda-meta")
"""What tells a folder that holds a Python of its own."""
_ESSENTIAL = ("extends", "plant", "sensors", "estimators")
"""Without any of these keys a file is no topology: it needs plant and estimators, or a base with them."""
_IS_IN_BRACES = re.compile(r"(?:[ \t]*(?:#.*|---)?[ \t]*\n)*(?:---)?[ \t]*\{")
_KEY_BEGINS_LINE = re.compile(rf"^[\"']?(?:{'|'.join(_ESSENTIAL)})[\"']?\s*:", re.MULTILINE)
_NAMES_SHOWN = 3


def find_files(paths: Iterable[Path], pattern: str = "") -> list[Path]:
    """Return the topology files that paths lead to: files as they are, folders with all below them.

    In a folder these are passed over: bases (``_*.yaml``), hidden folders, results of runs and campaigns,
    installed packages, virtual environments, and YAML files that are no topologies; of the last a line on
    standard error tells. With a ``pattern``, only files whose path contains it remain (``*`` stands for any
    characters). Raises `InputError` when a path leads to no file.
    """
    found: dict[Path, None] = {}
    foreign: dict[Path, None] = {}
    for path in paths:
        if not path.exists():
            raise InputError(f"{path} does not exist; name topology files, or folders that hold some")
        if not path.is_dir():
            found[path] = None
            continue
        below = _below(path)
        others = [file for file in below if not _may_be_topology(file)]
        files = [file for file in below if file not in others]
        if not files:
            raise InputError(_none_in(path, others))
        found.update(dict.fromkeys(files))
        foreign.update(dict.fromkeys(others))
    chosen = _chosen(found, pattern)
    if not chosen:
        raise InputError(f"none of the {len(found)} files has '{pattern}' in its path; choose another -k")
    passed_over = _chosen(foreign.keys() - found.keys(), pattern)
    if passed_over:
        print(
            f"passed over {_no_topologies(sorted(passed_over))}; name one outright to run it", file=sys.stderr
        )
    return chosen


def _chosen(files: Iterable[Path], pattern: str) -> list[Path]:
    return [path for path in files if fnmatchcase(path.as_posix(), f"*{pattern}*")]


def _none_in(folder: Path, others: Sequence[Path]) -> str:
    if others:
        return f"{folder} holds no topology file, only {_no_topologies(others)}"
    return (
        f"{folder} holds no topology file: none ends in .yaml and begins with no '_', outside of hidden "
        "folders, results of runs, and installed packages"
    )


def _no_topologies(files: Sequence[Path]) -> str:
    more = f" and {len(files) - _NAMES_SHOWN} more" if len(files) > _NAMES_SHOWN else ""
    keys = ", ".join(f"'{key}'" for key in _ESSENTIAL)
    return f"{', '.join(map(str, files[:_NAMES_SHOWN]))}{more}, without any of the keys {keys}"


def _below(folder: Path) -> list[Path]:
    """Return the YAML files in a folder that may be tests by their names and places."""
    found = []
    for parent, folders, names in os.walk(folder):
        if _is_result(names):
            folders.clear()
            continue
        folders[:] = [name for name in folders if _is_searched(Path(parent, name))]
        files = [Path(parent, name) for name in names if name.endswith(_ENDINGS) and name[0] != "."]
        found += [file for file in files if not is_base(file)]
    return sorted(found)


def _is_result(names: Collection[str]) -> bool:
    """Return whether a folder with these files holds a run, even one whose log was removed, or a campaign."""
    beside = SCORE in names or TIMING in names
    return LOG in names or _CAMPAIGN in names or (TOPOLOGY in names and beside)


def _is_searched(folder: Path) -> bool:
    is_environment = any((folder / name).exists() for name in _ENVIRONMENT)
    return folder.name[0] != "." and folder.name not in _PACKAGES and not is_environment


def _may_be_topology(file: Path) -> bool:
    """Return whether a YAML file has a key of topologies, or cannot be opened, of which its run will tell."""
    try:
        text = file.read_text(encoding="utf-8-sig", errors="replace")
    except OSError:
        return True
    if not _IS_IN_BRACES.match(text):  # reading foreign files for certain would take long
        return _KEY_BEGINS_LINE.search(text) is not None
    document = read_document(file, Problems())
    return document is not None and any(key in document.mapping for key in _ESSENTIAL)
