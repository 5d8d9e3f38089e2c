"""From figures to the JSON that a page carries: each array once, in binary, colours as tokens."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.report.contents import Figure, View
from orchestrator.report.edges import with_edges
from orchestrator.report.palette import DARK, LIGHT, coloured, template


def _packed(array: np.ndarray[Any, Any]) -> dict[str, str]:
    """Return an array of numbers as Plotly reads it.

    Single precision, double where a number is too large or too small for that, or the smallest whole numbers.
    """
    if array.dtype.kind == "f":
        dtype = "f4" if _is_single(array) else "f8"
        data = array.astype(f"<{dtype}")
    else:
        low, high = (int(array.min()), int(array.max())) if array.size else (0, 0)
        small = low >= -(2**15) and high < 2**15
        data, dtype = array.astype("<i2" if small else "<i4"), "i2" if small else "i4"
    return {"dtype": dtype, "bdata": base64.b64encode(np.ascontiguousarray(data).tobytes()).decode()}


def _is_single(array: np.ndarray[Any, Any]) -> bool:
    """Return whether every finite number keeps its first digits in single precision."""
    sizes = np.abs(array[np.isfinite(array) & (array != 0.0)])
    limits = np.finfo(np.float32)
    return not sizes.size or bool(sizes.max() <= limits.max and sizes.min() >= limits.tiny)


class _Store:
    """The arrays of a page; equal ones are held once, and each is known by its number."""

    def __init__(self) -> None:
        self.arrays: list[dict[str, str]] = []
        self._numbers: dict[tuple[str, str], int] = {}

    def plain(self, value: Any) -> Any:
        """Return a value with ``{"array": number}`` for its arrays, and null for what is not finite."""
        if isinstance(value, np.ndarray):
            return self._stored(value)
        if isinstance(value, dict):
            return {key: self.plain(item) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [self.plain(item) for item in value]
        if isinstance(value, np.generic):
            return self.plain(value.item())
        return None if isinstance(value, float) and not math.isfinite(value) else value

    def _stored(self, array: np.ndarray[Any, Any]) -> Any:
        if array.dtype.kind not in "fiub" or array.ndim != 1:
            return [self.plain(item) for item in array] if array.ndim > 1 else self.plain(array.tolist())
        packed = _packed(array)
        key = packed["dtype"], packed["bdata"]
        if key not in self._numbers:
            self._numbers[key] = len(self.arrays)
            self.arrays.append(packed)
        return {"array": self._numbers[key]}


def _figure(figure: Figure, store: _Store) -> dict[str, Any]:
    return {
        "name": figure.name,
        "height": figure.height,
        "aspect": figure.aspect,
        "layout": store.plain(figure.layout),
        "views": {
            "|".join(key): {
                "traces": store.plain(with_edges(view.traces, _merged(figure.layout, view.layout))),
                "layout": store.plain(view.layout),
            }
            for key, view in figure.views.items()
        },
    }


def payload(figures: Sequence[Figure]) -> str:
    """Return the JSON of all figures, safe inside a script element."""
    store = _Store()
    content = {
        "figures": [_figure(figure, store) for figure in figures],
        "template": template(),
        "palettes": {"light": LIGHT, "dark": DARK},
    }
    content["arrays"] = store.arrays
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _merged(base: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """Return layouts merged key by key, dictionaries in depth."""
    merged = dict(base)
    for key, value in more.items():
        both = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = _merged(merged[key], value) if both else value
    return merged


def plotly_figure(figure: Figure, view: View, palette: dict[str, str]) -> dict[str, Any]:
    """Return one view of a figure as Plotly's Python package takes it, with its template."""
    layout = _merged(figure.layout, view.layout)
    return {
        "data": coloured(with_edges(view.traces, layout), palette),
        "layout": coloured({**layout, "template": {"layout": template()}}, palette),
    }
