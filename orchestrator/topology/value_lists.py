"""Values that commas separate, as in ``--set path=v1,v2``."""

from __future__ import annotations

_OPENING, _CLOSING, _QUOTES = "([{", ")]}", "'\""
_BEFORE_A_QUOTE = ("", *"([{,:")


def split_values(text: str) -> list[str]:
    """Return the values that commas separate; commas in brackets, braces or quotes belong to a value."""
    values, depth, quote, begin = [], 0, "", 0
    for place, sign in enumerate(text):
        if quote:
            quote = "" if sign == quote else quote
        elif sign in _QUOTES and text[begin:place].rstrip()[-1:] in _BEFORE_A_QUOTE:
            quote = sign
        elif sign in _OPENING:
            depth += 1
        elif sign in _CLOSING:
            depth -= 1
        elif sign == "," and depth <= 0:
            values.append(text[begin:place].strip())
            begin = place + 1
    return [*values, text[begin:].strip()]
