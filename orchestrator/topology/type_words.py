"""JSON Schemas of values in words: what a person writes there."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

_PLAIN = {
    "integer": "whole number",
    "number": "number",
    "string": "text",
    "boolean": "true or false",
    "null": "null",
    "object": "mapping",
}
_BOUNDS = {
    "minimum": "at least",
    "exclusiveMinimum": "above",
    "maximum": "at most",
    "exclusiveMaximum": "below",
}
_LONGEST_DEFAULT = 60
_ANY = 2**53 - 1
"""A bound that only says what JSON can hold."""


def type_words(schema: Mapping[str, Any]) -> str:
    """Return what a schema allows: ``number above 0``. Types with names of their own are linked.

    Null is not told: it counts as not given.
    """
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in schema:
        options = [option for option in schema["anyOf"] if option.get("type") != "null"]
        return ", or ".join(dict.fromkeys(type_words(option) for option in options))
    if "enum" in schema or "const" in schema:
        options = schema.get("enum", [schema.get("const")])
        return ", ".join(f"`{option}`" for option in options)
    kind = schema.get("type")
    if kind == "array":
        return _list_words(schema)
    if kind == "object" and isinstance(schema.get("additionalProperties"), dict):
        return f"mapping of names to {type_words(schema['additionalProperties'])}"
    return _PLAIN.get(str(kind), "anything") + _bounds(schema)


def _list_words(schema: Mapping[str, Any]) -> str:
    least, most, items = schema.get("minItems"), schema.get("maxItems"), schema.get("items", {})
    words = type_words(items)
    of = f"list of ({words})" if "anyOf" in items or "enum" in items else f"list of {words}"
    if least is not None and least == most:
        return f"{of} ({least} of them)"
    return f"{of} (at least {least})" if least else of


def _bounds(schema: Mapping[str, Any]) -> str:
    told = [f"{word} {schema[key]:g}" for key, word in _BOUNDS.items() if abs(schema.get(key, _ANY)) < _ANY]
    return f" {' and '.join(told)}" if told else ""


def default_words(schema: Mapping[str, Any], *, required: bool) -> str:
    """Return the default that a schema states; long ones are those of the kind."""
    if required:
        return "needed"
    if "default" not in schema or schema["default"] is None:
        return "none"
    default = schema["default"]
    if isinstance(default, dict):
        default = {key: value for key, value in default.items() if value is not None}
    text = json.dumps(default, ensure_ascii=False)
    return f"`{text}`" if len(text) <= _LONGEST_DEFAULT else "the kind's own"
