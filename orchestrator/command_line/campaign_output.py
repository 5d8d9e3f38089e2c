"""What `gauntlet sweep` shows: progress with the time left, and what the campaign came to."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID

    from orchestrator.campaign.figures import Figure
    from orchestrator.campaign.summary import Summary

_PLAIN_EVERY_S = 30.0
_PLAIN_WIDTH = 160
_MESSAGES_SHOWN = 3
_FAILED_SHOWN = 6
"""How many failed trials of a variant are named, and of how many variants they are."""
_SHORT = {
    "nees.ratio": "median NEES",
    "divergences": "trials diverged",
    "detector.recall": "attacked rejected",
    "detector.false_alarm_rate": "genuine rejected",
}
"""Figures that the table shows beside the errors, and what it calls them."""


class QuietProgress:
    """Tells nothing."""

    def begin(self, total: int, done: int) -> None:
        """Take the number of all trials, and of those that were done before."""

    def advance(self, finished: int, failed: int) -> None:
        """Take the number of trials that a block finished, and how many of them failed."""


class PlainProgress(QuietProgress):
    """Writes a line to standard error now and then."""

    def begin(self, total: int, done: int) -> None:
        """Say how much there is to do."""
        self._total, self._done, self._before, self._failed = total, done, done, 0
        self._begun_s = self._told_s = time.monotonic()
        resumed = f", {done} of them done before" if done else ""
        typer.echo(f"{total} trials{resumed}", err=True)

    def advance(self, finished: int, failed: int) -> None:
        """Say how far it is, if the last word is old, or all is done."""
        self._done += finished
        self._failed += failed
        now_s = time.monotonic()
        if now_s - self._told_s < _PLAIN_EVERY_S and self._done < self._total:
            return
        self._told_s = now_s
        rate = (self._done - self._before) / max(now_s - self._begun_s, 1e-9)
        left = (self._total - self._done) / rate
        failures = f", {self._failed} failed" if self._failed else ""
        typer.echo(
            f"trial {self._done} of {self._total}{failures}, {rate:.3g} a second, {left:.0f} s left", err=True
        )


class BarProgress(QuietProgress):
    """Moves a bar."""

    def __init__(self, bar: Progress) -> None:
        self._bar = bar
        self._task: TaskID | None = None
        self._failed = 0

    def begin(self, total: int, done: int) -> None:
        """Show the bar."""
        self._task = self._bar.add_task("trials", total=total, completed=done, failures="")

    def advance(self, finished: int, failed: int) -> None:
        """Move it."""
        assert self._task is not None
        self._failed += failed
        failures = f"{self._failed} failed" if self._failed else ""
        self._bar.update(self._task, advance=finished, failures=failures)


@contextmanager
def sweep_progress(*, quiet: bool) -> Iterator[QuietProgress]:
    """Show progress on standard error: a bar on a terminal, a line now and then elsewhere."""
    if quiet:
        yield QuietProgress()
    elif not sys.stderr.isatty():
        yield PlainProgress()
    else:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (
            *(TextColumn("trials"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()),
            TextColumn("[red]{task.fields[failures]}"),
        )
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            yield BarProgress(bar)


def _shown(figure: Figure | None) -> str:
    if figure is None:
        return "-"
    if figure.kind == "trials":
        return f"{figure.events} of {figure.chances}"
    return f"{100.0 * figure.value.value:.3g} %" if figure.kind == "rate" else f"{figure.value.value:.3g}"


def _with_interval(figure: Figure | None) -> str:
    if figure is None or math.isnan(figure.value.low):
        return _shown(figure)
    return f"{_shown(figure)} [{figure.value.low:.3g}, {figure.value.high:.3g}]"


def sweep_console() -> Console:
    """Return the console for the table: plain text and broad when it is no terminal."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else _PLAIN_WIDTH)


def print_summary(summary: Summary, console: Console) -> None:
    """Print the table of variants and estimators, and what went wrong.

    Where the console is too narrow for the intervals they are left out.
    """
    from rich.text import Text

    errors = [name for name in summary.metrics if name.startswith("rmse.")]
    others = [name for name in summary.metrics if name in _SHORT]
    rows = _rows(summary, errors, others, _with_interval)
    levels = set(summary.confidence.values())
    level = f"{100.0 * levels.pop():g} % " if len(levels) == 1 else ""
    rates = any(name.startswith("detector.") for name in others)
    packets = "; rejected: share of the packets of all trials" if rates else ""
    title = f"RMSE by state group: medians over trials with {level}intervals{packets}"
    if sum(_widths(rows)) + 2 * len(rows[0]) > console.width:
        rows = _rows(summary, errors, others, _shown)
        title = f"RMSE by state group: medians over trials{packets}"
    widths = _widths(rows)
    console.print(Text(title, style="bold"))
    for row in rows:
        if len(row) == 1:
            console.print(Text(row[0], style="bold"), soft_wrap=True)
        else:
            cells = [row[0].ljust(widths[0])] + [
                cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)
            ]
            console.print(Text("  ".join(cells).rstrip()), soft_wrap=True)
    messages = list(dict.fromkeys(message for tally in summary.tallies for message in tally.messages))
    for message in messages[:_MESSAGES_SHOWN]:
        console.print(Text(f"failed: {message}", style="red"), soft_wrap=True)
    if len(messages) > _MESSAGES_SHOWN:
        console.print(Text(f"and {len(messages) - _MESSAGES_SHOWN} other reasons"))
    failing = [tally for tally in summary.tallies if tally.failed]
    for tally in failing[:_FAILED_SHOWN]:
        where = f"variant {tally.variant}: " if len(summary.tallies) > 1 else ""
        more = ", ..." if tally.failed > _FAILED_SHOWN else ""
        named = ", ".join(map(str, tally.failed_trials[:_FAILED_SHOWN]))
        console.print(Text(f"failed trials: {where}{named}{more}"), soft_wrap=True)
    if len(failing) > _FAILED_SHOWN:
        console.print(Text(f"and those of {len(failing) - _FAILED_SHOWN} other variants"))


def _rows(
    summary: Summary,
    errors: Sequence[str],
    others: Sequence[str],
    error_cell: Callable[[Figure | None], str],
) -> list[list[str]]:
    """Return the cells of the table; a row of one cell is the heading of a variant."""
    headings = [_SHORT.get(name, name.removeprefix("rmse.")) for name in (*errors, *others)]
    rows = [["estimator", *headings]]
    for tally in summary.tallies:
        settings = ", ".join(f"{path}={value}" for path, value in tally.settings.items())
        heading = f"{tally.variant}: {settings}" if settings else "all trials"
        failed = f", {tally.failed} FAILED" if tally.failed else ""
        rows.append([f"{heading}  ({tally.passed} of {tally.trials} passed{failed})"])
        rows += [
            [f"  {line.who}"]
            + [error_cell(line.figures.get(name)) for name in errors]
            + [_shown(line.figures.get(name)) for name in others]
            for line in summary.lines
            if line.variant == tally.variant
        ]
    return rows


def _widths(rows: Sequence[Sequence[str]]) -> list[int]:
    """Return the width of each column, headings of variants aside."""
    return [max(map(len, column)) for column in zip(*(row for row in rows if len(row) > 1), strict=True)]
