"""Colours by what they mean, for the light and the dark page.

The categorical ones are those of Okabe and Ito (2008), which people with any colour vision tell apart; on the
dark page they are lighter, so that each keeps a contrast of at least 3 to 1 with the paper. What lines mean
is also told by their dashes, and what points mean by their shapes.
"""

from __future__ import annotations

import re
from typing import Any

LIGHT = {
    "ink": "#1b1f24",
    "muted": "#57606a",
    "line": "#8c959f",
    "grid": "#e4e8ec",
    "paper": "#ffffff",
    "raised": "#ffffff",
    "attack": "#d55e00",
    "blue": "#0072b2",
    "green": "#008a63",
    "pink": "#b8588f",
    "amber": "#b87800",
    "sky": "#3a93c9",
    "brown": "#7a5c2e",
    "slate": "#5b6b7b",
}

DARK = {
    "ink": "#e6edf3",
    "muted": "#9aa7b4",
    "line": "#6e7b88",
    "grid": "#2b333c",
    "paper": "#14191f",
    "raised": "#1d242c",
    "attack": "#ff8a4c",
    "blue": "#5cb3f0",
    "green": "#35c99f",
    "pink": "#e69ac6",
    "amber": "#f0b748",
    "sky": "#93d2f7",
    "brown": "#cda870",
    "slate": "#9fb0c0",
}

SERIES = ("blue", "green", "pink", "amber", "sky", "brown", "slate")
"""What series take in turn; `attack` is kept for attacks, `ink` for the truth."""

DASHES = ("solid", "dash", "dot", "dashdot", "longdash")

SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "star", "hexagon")

LOSS = ("#b6c2cd", "#7fb2d6", "#3a8dc4", "#12649b", "#0b3f66")
"""From no loss to much loss, on the light page; on the dark one in the opposite order."""

LIGHT.update({f"loss{rank}": colour for rank, colour in enumerate(LOSS)})
DARK.update(
    {
        f"loss{rank}": colour
        for rank, colour in enumerate(("#4a5663", "#5a86a8", "#6db0dd", "#a3d3f5", "#e2f3ff"))
    }
)

_TOKEN = re.compile(r"\$([a-z]+\d?)(?:/(\d+))?")


def series_style(number: int) -> dict[str, Any]:
    """Return the line of the series of a number: colour and dash together are its own."""
    return {
        "color": f"${SERIES[number % len(SERIES)]}",
        "dash": DASHES[number // len(SERIES) % len(DASHES)],
    }


def colour(token: str, palette: dict[str, str]) -> str:
    """Return a token's colour as CSS writes it; any other text as it is."""
    match = _TOKEN.fullmatch(token)
    if match is None or match[1] not in palette:
        return token
    value = palette[match[1]]
    if match[2] is None:
        return value
    red, green, blue = (int(value[at : at + 2], 16) for at in (1, 3, 5))
    return f"rgba({red},{green},{blue},{int(match[2]) / 100:g})"


def coloured(value: Any, palette: dict[str, str]) -> Any:
    """Return a figure's data with every token replaced; arrays are left as they are."""
    if isinstance(value, str):
        return colour(value, palette)
    if isinstance(value, dict):
        return {key: coloured(item, palette) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [coloured(item, palette) for item in value]
    return value


def template() -> dict[str, Any]:
    """Return what all figures' layouts have in common."""
    axis = {
        "gridcolor": "$grid",
        "zerolinecolor": "$grid",
        "linecolor": "$line",
        "tickcolor": "$line",
        "showline": True,
        "ticks": "outside",
        "ticklen": 4,
        "automargin": True,
        "title": {"standoff": 8, "font": {"size": 13}},
        "tickfont": {"size": 12},
        "exponentformat": "e",
        "minexponent": 5,
    }
    return {
        "font": {"family": "system-ui, -apple-system, 'Segoe UI', sans-serif", "size": 13, "color": "$ink"},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "margin": {"l": 52, "r": 14, "t": 14, "b": 44},
        "hoverlabel": {"bgcolor": "$raised", "bordercolor": "$line", "font": {"size": 13, "color": "$ink"}},
        "hovermode": "closest",
        "showlegend": False,
        "xaxis": axis,
        "yaxis": axis,
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "$muted", "activecolor": "$blue"},
    }
