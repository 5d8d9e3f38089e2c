"""Runs topology files as tests: every expectation of every file is a test case."""

from __future__ import annotations

import contextlib
import functools
import io
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

from orchestrator import exit_codes
from orchestrator.choices import Backend
from orchestrator.errors import InputError
from orchestrator.interrupts import Interrupted
from orchestrator.run import RunReport, run_topology
from orchestrator.run_directory import LOG, make_run_directory
from orchestrator.score.results import Outcome
from orchestrator.testing.workers import fresh_processes
from orchestrator.topology.load import load_topology
from orchestrator.topology.problems import TopologyError
from orchestrator.topology.resolved import Topology

_WORDS = {"<=": "at most", ">=": "at least", "==": "exactly"}
_NAMES_SHOWN = 3
_LOGS_OPTION = "--logs"


@dataclass(frozen=True)
class Options:
    """How the files are run; ``logs`` is where the logs of failing files are kept."""

    logs: Path
    backend: Backend = "inprocess"
    seed: int | None = None


@dataclass(frozen=True)
class Case:
    """One expectation and what became of it: ``message`` tells the numbers."""

    title: str
    passed: bool
    message: str


@dataclass(frozen=True)
class FileResult:
    """What became of a topology file.

    Parameters
    ----------
    path
        The file, as it was found.
    cases
        Its expectations; none when it states none, or when it came to no verdict.
    error
        Why it came to no verdict; empty when it did.
    detail
        What a failing run printed: a traceback, or what the nodes said.
    exit_code
        Of this file alone, as `orchestrator.exit_codes` has it.
    log
        The log of the run, kept when something failed.
    seconds
        Wall-clock time that it took.
    """

    path: Path
    cases: tuple[Case, ...] = ()
    error: str = ""
    detail: str = ""
    exit_code: int = exit_codes.PASSED
    log: Path | None = None
    seconds: float = 0.0

    @property
    def failures(self) -> tuple[Case, ...]:
        """The expectations that did not hold."""
        return tuple(case for case in self.cases if not case.passed)


def title(outcome: Outcome) -> str:
    """Return a name for an expectation: what is expected of what, without what was measured."""
    names = [*outcome.nodes, *outcome.links]
    shown = ", ".join(names[:_NAMES_SHOWN]) + (
        f" and {len(names) - _NAMES_SHOWN} more" if len(names) > 3 else ""
    )
    return f"{outcome.metric} {_WORDS[outcome.relation]} {outcome.bound:g}{f' of {shown}' if names else ''}"


def run_file(path: Path, options: Options) -> FileResult:
    """Run one file and hold its expectations against the score."""
    began = time.perf_counter()
    try:
        topology = load_topology(path, seed=options.seed)
    except TopologyError as error:
        return FileResult(path, error=str(error), exit_code=exit_codes.BAD_INPUT, seconds=_since(began))
    if not topology.expectations:
        return FileResult(path, seconds=_since(began))
    said = io.StringIO()
    try:
        directory = make_run_directory(None, topology.name, topology.plan.seed, options.logs, _LOGS_OPTION)
        with contextlib.redirect_stderr(said):
            report = run_topology(topology, directory, options.backend, lambda recorded: None, _LOGS_OPTION)
    except InputError as error:  # its own files cannot be written or read: the others' can
        return FileResult(path, (), str(error), said.getvalue(), exit_codes.RUN_FAILED, None, _since(began))
    return _result(path, topology, report, said.getvalue(), _since(began))


def _since(began: float) -> float:
    return time.perf_counter() - began


def _result(path: Path, topology: Topology, report: RunReport, said: str, seconds: float) -> FileResult:
    if report.exit_code == exit_codes.PASSED:
        shutil.rmtree(report.directory)
    log = report.directory / LOG
    cases = tuple(Case(title(own), own.passed, own.message) for own in report.score.expectations)
    if report.exit_code in (exit_codes.PASSED, exit_codes.EXPECTATION_FAILED):
        kept = log if report.exit_code else None
        return FileResult(path, cases, exit_code=report.exit_code, log=kept, seconds=seconds)
    error = f"{topology.name}, seed {topology.plan.seed}: {report.message}"
    return FileResult(path, (), error, said, report.exit_code, log, seconds)


@dataclass(frozen=True)
class _Pending:
    """A file that is run, here or in another process: how to wait for its result, and whether it is there."""

    path: Path
    result: Callable[[], FileResult]
    ready: Callable[[], bool]


def run_files(
    paths: Sequence[Path], options: Options, jobs: int = 1, tell: Callable[[FileResult], None] | None = None
) -> list[FileResult]:
    """Return what became of each file, in their order; ``jobs`` of them run at a time.

    ``tell`` is told each of them as soon as it is known. A signal (`Interrupted`, or a run that it ended)
    ends them all: files that have come to no verdict by then are told and returned as such.
    """
    results: list[FileResult] = []

    def keep(result: FileResult) -> None:
        results.append(result)
        if tell is not None:
            tell(result)

    with _begun(paths, options, jobs) as files:
        try:
            for file in files:
                keep(file.result())
                if results[-1].exit_code > exit_codes.RUN_FAILED:
                    raise Interrupted(results[-1].exit_code - 128)
        except Interrupted as interrupt:
            for file in files[len(results) :]:
                keep(file.result() if file.ready() else _interrupted(file.path, options, interrupt))
    return results


@contextlib.contextmanager
def _begun(paths: Sequence[Path], options: Options, jobs: int) -> Iterator[list[_Pending]]:
    if jobs == 1:
        yield [_Pending(path, functools.partial(run_file, path, options), lambda: False) for path in paths]
        return
    with fresh_processes(jobs) as pool:
        futures = [pool.submit(run_file, path, options) for path in paths]
        yield [
            _Pending(path, functools.partial(_result_of, path, future), future.done)
            for path, future in zip(paths, futures, strict=True)
        ]


def _result_of(path: Path, future: Future[FileResult]) -> FileResult:
    try:
        return future.result()
    except BrokenProcessPool:
        error = "a worker process died; run this file alone with `gauntlet run`"
        return FileResult(path, error=error, exit_code=exit_codes.RUN_FAILED)


def _interrupted(path: Path, options: Options, interrupt: Interrupted) -> FileResult:
    error = f"interrupted by {interrupt}; if it had begun, its log is in {options.logs}"
    return FileResult(path, error=error, exit_code=interrupt.exit_code)


def exit_code(results: Iterable[FileResult]) -> int:
    """Return the exit code of a suite: the largest of its files'."""
    return max((result.exit_code for result in results), default=exit_codes.PASSED)
