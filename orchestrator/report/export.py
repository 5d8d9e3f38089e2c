"""Figures as pictures, SVG or PNG: drawn by a headless Chromium through kaleido, with no network."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.choices import FigureFormat
from orchestrator.report.contents import Figure
from orchestrator.report.errors import ReportError
from orchestrator.report.page import MISSING
from orchestrator.report.palette import LIGHT
from orchestrator.report.payload import plotly_figure

WIDTH = 900
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE_S = 120.0

_RANDOM_ID = re.compile(r'id="defs-([0-9a-f]{6})"')


def find_browser() -> str | None:
    """Return the Chromium that is there: what BROWSER_PATH names, else one on the path."""
    named = os.environ.get("BROWSER_PATH")
    if named and Path(named).is_file():
        return named
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def picture(figure: Figure) -> dict[str, Any]:
    """Return a figure's first view as Plotly draws it alone: on white, with a legend of its own."""
    drawn = plotly_figure(figure, figure.initial, LIGHT)
    named = {trace.get("legendgroup") or trace.get("name") for trace in drawn["data"] if trace.get("name")}
    height = round(WIDTH * 0.8) if figure.aspect else figure.height + 60
    legend = {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "font": {"size": 12}}
    drawn["layout"] |= {
        "width": round(WIDTH * 0.8 / figure.aspect) if figure.aspect else WIDTH,
        "height": height,
        "paper_bgcolor": "#ffffff",
        "showlegend": len(named) > 1,
        "legend": legend,
        "margin": {"l": 60, "r": 20, "t": 60, "b": 50},
    }
    for number, trace in enumerate(drawn["data"]):
        trace["uid"] = f"{number:06d}"
    plain: dict[str, Any] = _listed(drawn)
    return plain


def _listed(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [_listed(item) for item in value.tolist()]
    if isinstance(value, dict):
        return {key: _listed(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_listed(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def export(figures: Sequence[Figure], out: Path, form: FigureFormat) -> list[Path]:
    """Write each figure's first view into a folder as NAME.svg or NAME.png, and return the files.

    Raises `ReportError` when kaleido or a Chromium is missing, or the folder cannot be written.
    """
    try:
        import kaleido
    except ImportError:
        raise ReportError(MISSING.format("kaleido to export figures")) from None
    browser = find_browser()
    if browser is None:
        raise ReportError(
            "exporting figures needs Chromium or Chrome, and none was found: install one, "
            "or set BROWSER_PATH to its program; the HTML report needs none"
        )
    paths = [out / f"{figure.name}.{form}" for figure in figures]
    try:
        out.mkdir(parents=True, exist_ok=True)
        kaleido.write_fig_from_object_sync(
            [
                {
                    "fig": drawn,
                    "path": str(path),
                    "opts": {"format": form, "scale": 2 if form == "png" else 1},
                }
                for drawn, path in zip(map(picture, figures), paths, strict=True)
            ],
            kopts={"path": browser, "mathjax": False, "timeout": PATIENCE_S},
        )
    except OSError as error:
        raise ReportError(f"{out} cannot be written: {error.strerror}; choose another --figures") from error
    except _failures() as error:
        cure = "set BROWSER_PATH to a Chromium or Chrome that runs here"
        raise ReportError(f"{browser} drew no pictures ({type(error).__name__}); {cure}") from error
    if form == "svg":
        for path in paths:
            _fix_ids(path)
    return paths


def _failures() -> tuple[type[Exception], ...]:
    from kaleido import errors

    return (
        errors.BrowserClosedError,
        errors.BrowserFailedError,
        errors.ChromeNotFoundError,
        errors.JavascriptError,
        errors.KaleidoError,
    )


def _fix_ids(path: Path) -> None:
    """Replace the random part of a picture's ids by its name, so that equal figures give equal files."""
    text = path.read_text()
    for found in sorted(set(_RANDOM_ID.findall(text))):
        text = text.replace(found, path.stem)
    path.write_text(text)
