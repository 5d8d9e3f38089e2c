"""The table of all comparisons: for a terminal, for Markdown, and as plain data."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.comparison import Comparison

_COLUMNS = ("row", "what", "median", "against", "its median", "ratio", "wanted", "met")
_RIGHT = ("median", "its median", "ratio")
_WIDTH = 132
_PACKAGES = ("eclipse-zenoh", "numpy", "helics", "mosaik")
_MET = {True: "yes", False: "NO", None: ""}


def machine() -> str:
    """Return one line on what was measured on: processors, Python, packages."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    versions = [f"Python {platform.python_version()}"]
    for package in _PACKAGES:
        try:
            versions.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return f"{os.cpu_count()} CPUs ({model}), {platform.system()}; {', '.join(versions)}"


def _number(figure: float | None) -> str:
    if figure is None:
        return "—"
    return f"{figure:,.0f}" if abs(figure) >= 1000.0 else f"{figure:.3g}"


def cells(comparison: Comparison) -> tuple[str, ...]:
    """Return a comparison as the texts of one row."""
    return (
        comparison.row,
        comparison.what,
        f"{_number(comparison.figure)} {comparison.unit}",
        comparison.note or comparison.other,
        _number(comparison.other_figure) if comparison.other else "",
        _number(comparison.ratio) if comparison.other else "",
        str(comparison.wanted or ""),
        _MET[comparison.met],
    )


def markdown(comparisons: Sequence[Comparison], repeats: int) -> str:
    """Return the table in Markdown, with the machine under it."""
    lines = ["| " + " | ".join(_COLUMNS) + " |", "|---|---|---:|---|---:|---:|---|---|"]
    lines += ["| " + " | ".join(cells(comparison)) + " |" for comparison in comparisons]
    return "\n".join([*lines, "", f"Medians of {repeats} interleaved runs on {machine()}.", ""])


def print_table(comparisons: Sequence[Comparison], repeats: int) -> None:
    """Print the table for people."""
    console = Console()
    if not console.is_terminal:
        console.width = _WIDTH
    table = Table(title=f"Medians of {repeats} interleaved runs", caption=machine())
    for column in _COLUMNS:
        table.add_column(column, justify="right" if column in _RIGHT else "left", no_wrap=column in _RIGHT)
    for comparison in comparisons:
        colour = {True: "green", False: "red", None: ""}[comparison.met]
        table.add_row(*cells(comparison), style=colour)
    console.print(table)
