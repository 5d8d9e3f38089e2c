"""In what a campaign that is asked for is another one than that of a directory: each difference once.

One change shows in several facts of ``campaign.json``: other values of a ``--set`` are other overrides, other
swept values, other variants and other topologies. What people can act on is told, and nothing that follows
from it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from orchestrator.campaign.grid import AS_GIVEN, ATTACKS, NONE

_SHOWN = 100
_BEFORE = 20
"""Letters of a long value that are shown, and how many of them before its first difference."""

_OPTIONS = {"seed": "--seed", "first_trial": "--first-trial"}
_TOLD_OTHERWISE = frozenset(
    {
        *("trials", "name", "file", "overrides", "swept", "variants", "topology_hashes", "versions", "code"),
        *_OPTIONS,
    }
)
_AS_COMMANDED = "give the command as it was there"
_AS_MADE = "use the versions that are there"
_RESTORED = "put the topology back as it was"
_CODE_RESTORED = "put the code back as it was"
_MOST_NAMES = 6


@dataclass(frozen=True)
class Difference:
    """A difference in a line, and what makes it good."""

    line: str
    cure: str


def differences(held: Mapping[str, Any], asked: Mapping[str, Any]) -> list[Difference]:
    """Return what is not the same in the facts of two campaigns, ``trials`` aside."""
    settings = _of_settings(held, asked)
    found = [*settings, *_of_options(held, asked)]
    titles = tuple(f"{facts.get('name')} ({facts.get('file')})" for facts in (held, asked))
    is_named_otherwise = held.get("file") == asked.get("file") and settings
    if titles[0] != titles[1] and not is_named_otherwise:
        found.append(Difference(_line("the topology", *titles), _AS_COMMANDED))
    if not found:
        found += _of_code(held, asked)
    if held.get("topology_hashes") != asked.get("topology_hashes") and not found:
        changed = "  the topology: its file, a file that it extends, or a class in it was changed"
        found.append(Difference(changed, _RESTORED))
    others = {name: (held.get(name), asked.get(name)) for name in (*held, *asked)}
    made = {name: pair for name, pair in others.items() if name not in _TOLD_OTHERWISE}
    before, now = (facts.get("versions", {}) for facts in (held, asked))
    made |= {name: (before.get(name), now.get(name)) for name in (*before, *now)}
    found += [
        Difference(_line(name, _text(there), _text(here)), _AS_MADE)
        for name, (there, here) in made.items()
        if there != here
    ]
    return found


def _of_code(held: Mapping[str, Any], asked: Mapping[str, Any]) -> list[Difference]:
    """Return in one line which code of a user's own is not as it was."""
    before, now = (facts.get("code", {}) for facts in (held, asked))
    names = [name for name in dict.fromkeys((*now, *before)) if now.get(name) != before.get(name)]
    if not names:
        return []
    shown = ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")
    return [Difference(f"  the code of {shown} was changed", _CODE_RESTORED)]


def _of_settings(held: Mapping[str, Any], asked: Mapping[str, Any]) -> list[Difference]:
    """Return the differences in what is set, path by path."""
    before, now = (_settings(facts) for facts in (held, asked))
    lines = [
        _line(name, before.get(name, "not given"), now.get(name, "not given"))
        for name in dict.fromkeys((*before, *now))
        if before.get(name) != now.get(name)
    ]
    if not lines and held.get("overrides") != asked.get("overrides"):
        lines = [_line("--set, in another order", *(", ".join(_paths(own)) for own in (held, asked)))]
    return [Difference(line, _AS_COMMANDED) for line in lines]


def _settings(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return what is set, by the option with its path; ``--twin`` stands in no override."""
    found: dict[str, str] = {}
    for override in facts.get("overrides", []):
        path, _, value = override.partition("=")
        name = f"--set {path}"
        found[name] = f"{found[name]} and {value}" if name in found else value
    if facts.get("swept", {}).get(ATTACKS) == [AS_GIVEN, NONE]:
        found["--twin"] = "given"
    return found


def _paths(facts: Mapping[str, Any]) -> list[str]:
    return [override.partition("=")[0] for override in facts.get("overrides", [])]


def _of_options(held: Mapping[str, Any], asked: Mapping[str, Any]) -> list[Difference]:
    return [
        Difference(_line(option, _text(held.get(name)), _text(asked.get(name))), _AS_COMMANDED)
        for name, option in _OPTIONS.items()
        if held.get(name) != asked.get(name)
    ]


def _line(what: str, there: str, here: str) -> str:
    """Return a difference in a line; long values are cut where they begin to differ."""
    same = next(
        (i for i, (a, b) in enumerate(zip(there, here, strict=False)) if a != b), min(len(there), len(here))
    )
    begin = same - _BEFORE if max(len(there), len(here)) > _SHOWN and same > _BEFORE else 0
    return f"  {what}: {_cut(there, begin)} there, {_cut(here, begin)} here"


def _cut(text: str, begin: int) -> str:
    end = begin + _SHOWN
    return ("..." if begin else "") + text[begin:end] + ("..." if len(text) > end else "")


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
