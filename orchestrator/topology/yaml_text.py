"""Plain data as YAML: what holds nothing but scalars on one line, everything else in blocks.

The YAML library takes longer to write a resolved topology than all the rest of reading and resolving it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

_PLAIN = re.compile(r"[A-Za-z_/][\w./*>-]*(?: [\w./*>()-]+)*", re.ASCII)
_OTHER_THAN_TEXT = re.compile(r"true|false|null", re.IGNORECASE)
_UNPRINTABLE = re.compile("[\x7f-\xa0\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]")  # what JSON lets pass


def yaml_text(document: Mapping[str, Any]) -> str:
    """Return a document of mappings, lists and scalars as YAML; keys are text, numbers finite."""
    return "".join(f"{line}\n" for line in (_block(document) if document else ["{}"]))


def _block(value: Any) -> Iterator[str]:
    """Yield the lines of a mapping or list."""
    if isinstance(value, Mapping):
        for key, member in value.items():
            if _is_flat(member):
                yield f"{_scalar(key)}: {_flat(member)}"
            else:
                indent = "  " if isinstance(member, Mapping) else ""
                yield f"{_scalar(key)}:"
                yield from (indent + line for line in _block(member))
    else:
        for item in value:
            lines = iter([_flat(item)] if _is_flat(item) else _block(item))
            yield f"- {next(lines)}"
            yield from (f"  {line}" for line in lines)


def _is_flat(value: Any) -> bool:
    """Return whether a value is a scalar, or holds scalars only."""
    members = value.values() if isinstance(value, Mapping) else value if isinstance(value, list) else ()
    return not any(isinstance(member, Mapping | list) for member in members)


def _flat(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_scalar(key)}: {_scalar(member)}" for key, member in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_scalar, value)) + "]"
    return _scalar(value)


def _scalar(value: Any) -> str:
    """Return a scalar as JSON has it, but text without quotes where it needs none."""
    if isinstance(value, str):
        if _PLAIN.fullmatch(value) and not _OTHER_THAN_TEXT.fullmatch(value):
            return value
        return _UNPRINTABLE.sub(
            lambda found: f"\\u{ord(found[0]):04x}", json.dumps(value, ensure_ascii=False)
        )
    return json.dumps(value, allow_nan=False)
