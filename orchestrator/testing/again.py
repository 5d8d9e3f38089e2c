"""A trial once more: by a command, or with its log in a process of its own, held against the trial."""

from __future__ import annotations

import contextlib
import io
import os
from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from orchestrator import exit_codes
from orchestrator.choices import Backend
from orchestrator.run import RunReport, run_topology
from orchestrator.run_directory import LOG, make_run_directory
from orchestrator.score.repetition import differences, shown
from orchestrator.score.results import Score
from orchestrator.testing.workers import fresh_processes
from orchestrator.topology.load import load_topology
from orchestrator.topology.resolved import Topology

STATE = (
    "some part of it keeps state between trials (a mutable class attribute, a global variable), or draws "
    "random numbers of its own"
)
"""Why a run does not repeat, as far as can be said of a user's code from outside."""


@dataclass(frozen=True)
class Source:
    """What trials are made of.

    Parameters
    ----------
    file
        The topology file.
    overrides
        What is overridden in it.
    directory
        What paths in overrides refer to.
    backend
        How the trials were run.
    trial
        The number that every random draw is addressed by, beside the seed.
    logs
        The folder for logs.
    logs_option
        What the user chooses that folder with, for the text of errors.
    """

    file: Path
    overrides: tuple[str, ...]
    directory: Path
    backend: Backend
    trial: int
    logs: Path
    logs_option: str

    def command(self, seed: int) -> str:
        """Return how to run a seed again from a shell."""
        file = os.path.relpath(self.file, self.directory)
        options = "".join(f" --set {quote(override)}" for override in self.overrides)
        run = f"gauntlet run {quote(file)} --seed {seed}{options} --backend {self.backend}"
        return f"again, in {quote(str(self.directory))}: {run}"


@dataclass(frozen=True)
class Record:
    """The log of a seed: its file, the score that it gives, and what ended its run early, if anything did."""

    log: Path
    score: Score
    message: str = ""


def run_with_log(topology: Topology, source: Source, backend: Backend) -> RunReport:
    """Run and keep everything that the run leaves, in a folder of its own."""
    directory = make_run_directory(
        None, topology.name, topology.plan.seed, parent=source.logs, option=source.logs_option
    )
    with contextlib.redirect_stderr(io.StringIO()):
        report = run_topology(topology, directory, backend, lambda recorded: None, source.logs_option)
    if report.exit_code > exit_codes.RUN_FAILED:
        raise KeyboardInterrupt(report.message)
    return report


def record_again(source: Source, seed: int) -> Record:
    """Run a seed once more and write its log, in a process that knows nothing of the trials before.

    That is how a command would run it. Raises what keeps the log from being written.
    """
    with fresh_processes(1) as pool:
        return pool.submit(_record, source, seed).result()


def _record(source: Source, seed: int) -> Record:
    loaded = load_topology(source.file, source.overrides, directory=source.directory)
    report = run_with_log(loaded.at(seed=seed, trial=source.trial), source, "inprocess")
    return Record(report.directory / LOG, report.score, report.message)


def departure(score: Score, record: Record) -> str:
    """Return how the record of a seed is not that of its trial; empty when it is."""
    if record.message:
        return f"the run does not repeat: this time it ended early, {record.message}\n{STATE}"
    found = differences(score, record.score)
    if not found:
        return ""
    (name, (held, logged)), *others = found.items()
    also = f"; {shown([other for other, _ in others])} differ too" if others else ""
    first = f"{name} is {_figure(logged)} in this log, and was {_figure(held)} in the trial"
    return f"the run does not repeat: {first}{also}\n{STATE}"


def _figure(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
