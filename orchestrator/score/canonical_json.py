"""Canonical JSON: equal scores are equal bytes, and people can read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

_encoder = msgspec.json.Encoder()


def _is_flat(value: Sequence[object]) -> bool:
    return not any(isinstance(entry, (Mapping, list, tuple)) for entry in value)


def _write(value: object, indent: str, out: list[bytes]) -> None:
    deeper = indent + "  "
    if isinstance(value, Mapping) and value:
        separator = "{"
        for key in sorted(value):
            out.append(f"{separator}\n{deeper}".encode() + _encoder.encode(key) + b": ")
            _write(value[key], deeper, out)
            separator = ","
        out.append(f"\n{indent}}}".encode())
    elif isinstance(value, (list, tuple)) and not _is_flat(value):
        separator = "["
        for entry in value:
            out.append(f"{separator}\n{deeper}".encode())
            _write(entry, deeper, out)
            separator = ","
        out.append(f"\n{indent}]".encode())
    else:
        out.append(_encoder.encode(value))


def canonical_json(value: object) -> bytes:
    """Return the JSON of a tree of mappings, lists and scalars, ended by a newline.

    Keys are sorted, numbers are shortest round-trip decimals, a list of scalars stands on one line, and every
    other level is indented by two spaces. The caller guarantees that every number is finite.
    """
    out: list[bytes] = []
    _write(value, "", out)
    return b"".join(out) + b"\n"
