"""What commands print: JSON, progress, and errors with the right exit code."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from orchestrator import exit_codes
from orchestrator.errors import InputError

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer
    from rich.console import Console

_PLAIN_LINES = 5


class _Pipe(io.FileIO):
    """A stream whose reader may leave: what comes after that goes nowhere."""

    def write(self, data: ReadableBuffer, /) -> int:
        """Write, or forget what nobody reads."""
        try:
            return super().write(data)
        except BrokenPipeError:
            return memoryview(data).nbytes


def outlive_readers() -> None:
    """Let commands go on when nobody reads what they print: ``gauntlet run ... | head`` runs to its end.

    The exit code then still says what became of the run.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper) and stream is getattr(sys, f"__{name}__"):
            raw = _Pipe(stream.fileno(), "wb", closefd=False)
            buffered = io.BufferedWriter(raw)
            tolerant = io.TextIOWrapper(
                buffered, stream.encoding, stream.errors, line_buffering=stream.line_buffering
            )
            setattr(sys, name, tolerant)


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
    """Show on standard error how many steps are recorded: a bar on a terminal, a few lines elsewhere."""
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


def fail(error: InputError | str, exit_code: int = exit_codes.BAD_INPUT) -> NoReturn:
    """Print what went wrong and leave; by default it was the user's input."""
    typer.echo(f"gauntlet: {error}", err=True)
    raise SystemExit(exit_code)
