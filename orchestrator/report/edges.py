"""Points that lie beyond a logarithmic axis: drawn at its edge, so that a cut axis hides nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.report.contents import Layout, Trace
from orchestrator.score.gather import Bools, Floats

KEY = "beyond the axis"
"""What the legend calls such points."""

_INSIDE = 0.025
"""How far inside the edge they stand, as a share of the axis."""

_UP, _DOWN = "arrow-bar-up", "arrow-bar-down"


def with_edges(traces: Sequence[Trace], layout: Layout) -> list[Trace]:
    """Return traces, and an arrow at the edge for every point of them beyond a logarithmic axis.

    Axes that are not logarithmic or have no ``range`` cut nothing; bands are cut without a word. Pointing at
    an arrow tells the true value, unless the figure tells all values of a step at once. What is zero or
    less has no place on such an axis and stands at its foot.
    """
    edges = [edge for trace in traces if (edge := _edge(trace, layout)) is not None]
    return [*traces, *edges, *([_key()] if edges else [])]


def _edge(trace: Trace, layout: Layout) -> Trace | None:
    axis = layout.get("yaxis" + str(trace.get("yaxis", "y"))[1:], {})
    values = trace.get("y")
    numeric = isinstance(values, np.ndarray) and values.dtype.kind in "fiu"
    if axis.get("type") != "log" or "range" not in axis or not numeric or "fill" in trace:
        return None
    y = np.asarray(values, dtype=np.float64)
    bottom, top = axis["range"]
    with np.errstate(divide="ignore", invalid="ignore"):
        heights = np.where(y > 0.0, np.log10(y), np.where(np.isnan(y), np.nan, -np.inf))
    outside = (heights > top) | (heights < bottom)
    if not outside.any():
        return None
    told = {"hoverinfo": "skip"} if str(layout.get("hovermode", "")).startswith("x") else {}
    return {**_arrows(trace, y, outside, heights > top, (bottom, top)), **told}


def _arrows(trace: Trace, y: Floats, outside: Bools, above: Bools, span: tuple[float, float]) -> Trace:
    at = np.flatnonzero(outside)
    inset = _INSIDE * (span[1] - span[0])
    colour = trace.get("marker", {}).get("color") or trace.get("line", {}).get("color")
    kept: Trace = {key: trace[key] for key in ("name", "visible", "xaxis", "yaxis") if key in trace}
    x = trace["x"]
    return {
        "type": "scatter",
        "mode": "markers",
        "x": x[at] if isinstance(x, np.ndarray) else [x[i] for i in at.tolist()],
        "y": 10.0 ** np.where(above[at], span[1] - inset, span[0] + inset),
        "customdata": [f"{value:.4g}" for value in y[at]],
        "hovertemplate": f"{trace.get('name', '')}, beyond the axis: %{{customdata}}<extra></extra>",
        "legendgroup": trace.get("legendgroup") or trace.get("name"),
        "showlegend": False,
        "marker": {
            "symbol": [_UP if up else _DOWN for up in above[at].tolist()],
            "size": 8,
            "color": colour,
            "line": {"width": 1.5, "color": colour},
        },
        **kept,
    }


def _key() -> Trace:
    """Return a trace without points that explains the arrows in the legend."""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [None],
        "y": [None],
        "name": KEY,
        "marker": {"symbol": _UP, "size": 8, "color": "$muted", "line": {"width": 1.5, "color": "$muted"}},
        "hoverinfo": "skip",
    }
