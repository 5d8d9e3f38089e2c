"""What commands print: JSON, progress, and errors with the right exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from orchestrator import exit_codes
from orchestrator.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

_PLAIN_LINES = 5


def print_json(value: Any) -> None:
    """Print a value as indented JSON."""
    import msgspec

    sys.stdout.write(msgspec.json.format(msgspec.json.encode(value), indent=2).decode() + "\n")


def verdict_console() -> Console:
    """Return the console for results: colours on a terminal, plain text elsewhere."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 100)


@contextmanager
def run_progress(steps: int, *, quiet: bool) -> Iterator[Callable[[int], None]]:
    """Show how many steps are recorded: a bar on a terminal, a few plain lines elsewhere, on standard error."""
    if quiet:
        yield lambda recorded: None
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("step"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("run", total=steps)
            yield lambda recorded: bar.update(task, completed=recorded)
    else:
        every = max(1, steps // _PLAIN_LINES)
        told = 0

        def tell(recorded: int) -> None:
            nonlocal told
            if recorded // every > told // every or (recorded == steps and told < steps):
                typer.echo(f"step {recorded} of {steps}", err=True)
            told = recorded

        yield tell


def fail(error: InputError) -> NoReturn:
    """Print an error of the user's input and leave with `BAD_INPUT`."""
    typer.echo(f"gauntlet: {error}", err=True)
    raise SystemExit(exit_codes.BAD_INPUT)
