"""What ``campaign.json`` says of a campaign, read from a file that may be damaged."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

CAMPAIGN = "campaign.json"


def _is_number(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _are_texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(own, str) for own in value)


def _is_table(value: object) -> bool:
    return isinstance(value, dict) and all(isinstance(own, str) for own in value.values())


_FACTS: Mapping[str, Callable[[Any], bool]] = {
    "name": lambda value: isinstance(value, str),
    "trials": _is_number,
    "first_trial": _is_number,
    "overrides": _are_texts,
    "swept": lambda value: isinstance(value, dict) and all(map(_are_texts, value.values())),
    "variants": lambda value: isinstance(value, list) and bool(value) and all(map(_is_table, value)),
    "topology_hashes": _are_texts,
    "versions": _is_table,
}
"""What ``campaign.json`` holds at least, and whether a value can be that."""


def campaign_facts(content: bytes) -> dict[str, Any]:
    """Return what ``campaign.json`` says; raises `ValueError` when that cannot be a campaign."""
    facts = json.loads(content)
    if not isinstance(facts, dict):
        raise ValueError(f"{CAMPAIGN} holds no facts")
    missing = [name for name in _FACTS if name not in facts]
    if missing:
        raise ValueError(f"{CAMPAIGN} lacks {', '.join(missing)}")
    wrong = [name for name, can_be in _FACTS.items() if not can_be(facts[name])]
    if (
        wrong
        or len(facts["variants"]) != len(facts["topology_hashes"])
        or not _is_table(facts.get("code", {}))
    ):
        raise ValueError(f"{CAMPAIGN} says something impossible of {', '.join(wrong or ['its variants'])}")
    return facts
