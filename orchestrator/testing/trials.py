"""Trials of one topology at many seeds, and what a test may assert of them."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

from bus.program import NodeError
from orchestrator import exit_codes
from orchestrator.choices import Backend
from orchestrator.run import RunReport, run_topology
from orchestrator.run_directory import LOG, make_run_directory
from orchestrator.score.gather import Gathered, Gatherer, gather
from orchestrator.score.results import Score
from orchestrator.testing import claims
from orchestrator.testing.claims import Claim, Names, Trial
from orchestrator.testing.consistency import consistent
from orchestrator.topology.resolved import Topology
from orchestrator.topology_score import score_topology

_SEEDS_SHOWN = 5


class TrialError(RuntimeError):
    """A trial came to no score; the text tells the seed, what failed, and where the log is."""


class Trials:
    """Runs of one topology at several seeds, and assertions over all of them.

    A failing assertion raises AssertionError: its text shows the numbers, the seeds that are to blame, how to
    run one of them again, and where its log was written.

    Parameters
    ----------
    topology
        What was run; each trial at its own seed.
    overrides
        What was overridden in its file, for the text of messages.
    trials
        The runs, in the order of the seeds.
    write_log
        Runs a seed again and returns its log.
    directory
        Where to run a seed again from: what the paths in overrides refer to.
    """

    def __init__(
        self,
        topology: Topology,
        overrides: Sequence[str],
        trials: Sequence[Trial],
        write_log: Callable[[int], Path],
        directory: Path,
    ) -> None:
        self.topology = topology
        self.trials = tuple(trials)
        self._overrides = overrides
        self._write_log = write_log
        self._directory = directory
        self._logs: dict[int, Path] = {}

    def __repr__(self) -> str:
        """Tell what was run."""
        return f"<{len(self.trials)} trials of {self.topology.name}>"

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds, in the order in which they were given."""
        return tuple(trial.seed for trial in self.trials)

    @property
    def scores(self) -> tuple[Score, ...]:
        """The score of each trial, in the order of the seeds."""
        return tuple(trial.score for trial in self.trials)

    def log(self, seed: int) -> Path:
        """Return the MCAP log of a seed; it is written when it is first asked for, by the same run again."""
        if seed not in self.seeds:
            raise ValueError(f"seed {seed} was not run; there is {', '.join(map(str, self.seeds))}")
        if seed not in self._logs:
            self._logs[seed] = self._write_log(seed)
        return self._logs[seed]

    def assert_passes(self) -> None:
        """Assert that every expectation of the file (``expect:``) holds at every seed."""
        __tracebackhide__ = True
        self._require(claims.passes(self.trials))

    def assert_rmse(
        self, group: str = "state", *, at_most: float, node: Names = None, each_seed: bool = False
    ) -> None:
        """Assert that the RMSE of a state group over all seeds and scored steps is at most a bound.

        ``node`` names estimators (``e1``, ``e1..e4``, ``e*`` or a list), each of which must keep the bound;
        None for all. With ``each_seed`` every seed must keep it alone. An estimator that diverged has an
        infinite RMSE.
        """
        __tracebackhide__ = True
        self._require(claims.rmse(self.topology, self.trials, group, at_most, node, each_seed=each_seed))

    def assert_consistent(self, *, node: Names = None, false_alarm: float = 1e-3) -> None:
        """Assert that covariances tell the truth: average NEES and NIS within chi-square bounds.

        NEES is averaged over the seeds in each step, NIS over seeds and steps. ``false_alarm`` is the
        probability that a linear Gaussian filter that knows its models fails this assertion as a whole: it is
        divided among estimators, figures and steps (Bonferroni), so correlated steps do no harm. A figure
        that an estimator never publishes is not judged; one that publishes neither fails, and so does one
        that publishes covariances of which any is missing or not positive definite.
        """
        __tracebackhide__ = True
        self._require(consistent(self.topology, self.trials, node, false_alarm))

    def assert_detects_within(self, steps: int, *, share: float = 1.0, link: Names = None) -> None:
        """Assert that detectors find attacks soon: at least a share of the windows within some steps.

        A window is one attack on one link in one trial. One that the run's end cut off before ``steps`` steps
        had passed is left out, found or not: those that are found early would else count alone. A failure
        tells how many these are, and when no window is left, that is one.
        """
        __tracebackhide__ = True
        if steps < 0 or not 0.0 < share <= 1.0:
            raise ValueError(
                f"steps={steps}, share={share:g}: give steps from 0, and a share above 0, up to 1"
            )
        self._require(claims.detects_within(self.topology, self.trials, steps, share, link))

    def assert_metric(
        self,
        metric: str,
        *,
        at_most: float | None = None,
        at_least: float | None = None,
        equals: float | None = None,
        node: Names = None,
        link: Names = None,
    ) -> None:
        """Assert bounds on any metric that ``expect:`` knows, at every seed."""
        __tracebackhide__ = True
        bounds = {"at_most": at_most, "at_least": at_least, "equals": equals}
        self._require(claims.metric(self.topology, self.trials, metric, bounds, node, link))

    def _require(self, claim: Claim) -> None:
        __tracebackhide__ = True
        if not claim.holds:
            raise AssertionError(self._tell(claim))

    def _tell(self, claim: Claim) -> str:
        """Return what went wrong, for people."""
        seeds = self.seeds
        span = f"seed {seeds[0]}" if len(seeds) == 1 else f"{len(seeds)} seeds, {seeds[0]} to {seeds[-1]}"
        lines = [f"{self.topology.name} ({self.topology.path}), {span}:", *claim.lines]
        if claim.blamed:
            shown = [f"seed {seed} ({why})" for seed, why in claim.blamed[:_SEEDS_SHOWN]]
            more = "; ..." if len(claim.blamed) > _SEEDS_SHOWN else ""
            lines.append(f"{claim.blame}: {'; '.join(shown)}{more}")
            worst = claim.blamed[0][0]
            options = "".join(f" --set '{override}'" for override in self._overrides)
            file = os.path.relpath(self.topology.path, self._directory)
            lines.append(f"again, in {self._directory}: gauntlet run {file} --seed {worst}{options}")
            lines.append(f"log of seed {worst}: {self.log(worst)}")
        return "\n".join(lines)


def run_trials(
    topology: Topology,
    seeds: Sequence[int],
    logs: Path,
    backend: Backend = "inprocess",
    overrides: Sequence[str] = (),
    directory: Path | None = None,
) -> Trials:
    """Run a topology at each seed.

    Parameters
    ----------
    topology
        What to run.
    seeds
        At which seeds; their runs are independent of one another.
    logs
        Folder for the logs of seeds that fail, and of all seeds with the backend ``processes``.
    backend
        One process a node, or all in this one; the results are the same.
    overrides
        What was overridden in the topology's file, for the text of messages.
    directory
        What paths in the overrides refer to; None for the current directory.

    Raises
    ------
    TrialError
        When a node's code raises, or a run fails otherwise.
    """
    __tracebackhide__ = True
    if not seeds:
        raise ValueError("there are no seeds to run; give at least one, as in seeds=range(20)")
    if min(seeds) < 0:
        raise ValueError(f"seed {min(seeds)} is negative; give whole numbers from 0")

    def write_log(seed: int) -> Path:
        return _run_with_log(topology.at(seed=seed), logs, "inprocess").directory / LOG

    run = _run_in_memory if backend == "inprocess" else _run_in_processes
    trials = [run(topology.at(seed=seed), logs) for seed in seeds]
    return Trials(topology, overrides, trials, write_log, directory or Path.cwd())


def _run_in_memory(topology: Topology, logs: Path) -> Trial:
    __tracebackhide__ = True
    from orchestrator.backends.inprocess import run_messages

    gatherer = Gatherer(topology.plan)
    try:
        run_messages(topology.plan, gatherer.take)
    except NodeError as error:
        report = _run_with_log(topology, logs, "inprocess")
        _fail(topology, str(error), report.directory / LOG, error)
    return _trial(topology, gatherer.finish())


def _run_in_processes(topology: Topology, logs: Path) -> Trial:
    __tracebackhide__ = True
    from orchestrator.log.reader import read_log

    report = _run_with_log(topology, logs, "processes")
    log = report.directory / LOG
    if report.exit_code not in (exit_codes.PASSED, exit_codes.EXPECTATION_FAILED):
        _fail(topology, report.message, log)
    held = read_log(log)
    return _trial(topology, gather(topology.plan, held.records()), held.departed)


def _run_with_log(topology: Topology, logs: Path, backend: Backend) -> RunReport:
    """Run and keep everything that the run leaves, in a folder of its own."""
    directory = make_run_directory(None, topology.name, topology.plan.seed, parent=logs)
    with contextlib.redirect_stderr(io.StringIO()):
        report = run_topology(topology, directory, backend, lambda recorded: None)
    if report.exit_code > exit_codes.RUN_FAILED:
        raise KeyboardInterrupt(report.message)
    return report


def _fail(topology: Topology, message: str, log: Path, cause: BaseException | None = None) -> NoReturn:
    __tracebackhide__ = True
    place = f"{topology.name} ({topology.path}), seed {topology.plan.seed}"
    raise TrialError(f"{place}: {message}\nlog up to there: {log}") from cause


def _trial(topology: Topology, gathered: Gathered, departed: Mapping[str, int] | None = None) -> Trial:
    return Trial(topology.plan.seed, *score_topology(topology, gathered, departed))
