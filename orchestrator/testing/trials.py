"""Trials of one topology at many seeds, and what a test may assert of them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

from bus.program import NodeError
from orchestrator import exit_codes
from orchestrator.choices import Backend
from orchestrator.run_directory import LOG
from orchestrator.score.gather import Gathered, Gatherer, gather
from orchestrator.score.results import Score
from orchestrator.testing import claims
from orchestrator.testing.again import STATE, Record, Source, departure, record_again, run_with_log
from orchestrator.testing.asked import read_overrides, read_seeds, read_steps
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
    trials
        The runs, in the order of the seeds.
    source
        What they were made of, to run a seed again.
    records
        By seed: the logs that there are already.
    """

    def __init__(
        self,
        topology: Topology,
        trials: Sequence[Trial],
        source: Source,
        records: Mapping[int, Record] | None = None,
    ) -> None:
        self.topology = topology
        self.trials = tuple(trials)
        self._source = source
        self._records = dict(records or {})

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
        """Return the MCAP log of a seed.

        Of trials in one process it is written when it is first asked for, by a run in a process of its own.
        Warns when that run came out otherwise than the trial.
        """
        if seed not in self.seeds:
            raise ValueError(f"seed {seed} was not run; there is {', '.join(map(str, self.seeds))}")
        record = self._record(seed)
        if differs := self._departure(seed, record):
            warnings.warn(f"log of seed {seed}: {differs}", stacklevel=2)
        return record.log

    def _record(self, seed: int) -> Record:
        if seed not in self._records:
            self._records[seed] = record_again(self._source, seed)
        return self._records[seed]

    def _departure(self, seed: int, record: Record) -> str:
        return departure(self.scores[self.seeds.index(seed)], record)

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

        A window is one attack on one link in one trial. Without ``link`` those links count, in all trials, on
        which any trial has a verdict; a trial without one missed what was there. A window that the run's end
        cut off before ``steps`` steps had passed is left out, found or not: those that are found early would
        else count alone. A failure tells how many are left out, and when no window is left, that is one.
        """
        __tracebackhide__ = True
        steps = read_steps(steps)
        if not 0.0 < share <= 1.0:
            raise ValueError(f"share={share:g}: give a share above 0, up to 1")
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
            lines += [self._source.command(worst), self._tell_log(worst)]
        return "\n".join(lines)

    def _tell_log(self, seed: int) -> str:
        """Return where the log of a seed is; a log that cannot be had hides nothing else."""
        try:
            record = self._record(seed)
        except Exception as error:
            return f"there is no log of seed {seed}: {error}"
        differs = self._departure(seed, record)
        return f"log of seed {seed}: {record.log}" + (f"\n{differs}" if differs else "")


def run_trials(
    topology: Topology,
    seeds: Sequence[int],
    logs: Path,
    backend: Backend = "inprocess",
    overrides: Sequence[str] = (),
    directory: Path | None = None,
    logs_option: str = "logs",
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
        What was overridden in the topology's file.
    directory
        What paths in the overrides refer to; None for the current directory.
    logs_option
        What the user chooses ``logs`` with, for the text of errors.

    Raises
    ------
    TrialError
        When a node's code raises, or a run fails otherwise.
    TypeError, ValueError
        For seeds that cannot be meant.
    RunDirectoryError
        When the folder for logs cannot be used, with the backend ``processes``.
    """
    __tracebackhide__ = True
    chosen, changes, here = read_seeds(seeds), read_overrides(overrides), directory or Path.cwd()
    trial = topology.plan.trial
    source = Source(topology.path, changes, here, backend, trial, logs, logs_option)
    if backend == "inprocess":
        return Trials(topology, [_run_in_memory(topology.at(seed=seed), source) for seed in chosen], source)
    pairs = [_run_in_processes(topology.at(seed=seed), source) for seed in chosen]
    records = {trial.seed: record for trial, record in pairs}
    return Trials(topology, [trial for trial, _ in pairs], source, records)


def _run_in_memory(topology: Topology, source: Source) -> Trial:
    __tracebackhide__ = True
    from orchestrator.backends.inprocess import run_messages

    gatherer = Gatherer(topology.plan)
    try:
        run_messages(topology.plan, gatherer.take)
    except NodeError as error:
        raise _failed(topology, str(error), _tell_failed_again(source, topology.plan.seed, error)) from error
    return _trial(topology, gatherer.finish())


def _tell_failed_again(source: Source, seed: int, error: NodeError) -> str:
    """Return where the log of a run is that failed, up to there; it is run once more for that."""
    try:
        record = record_again(source, seed)
    except Exception as reason:
        return f"there is no log: {reason}"
    if record.message == str(error):
        return f"log up to there: {record.log}"
    ended = f"ended early, {record.message}" if record.message else "came to its end"
    return f"log: {record.log}\nthe run does not repeat: this time it {ended}\n{STATE}"


def _run_in_processes(topology: Topology, source: Source) -> tuple[Trial, Record]:
    __tracebackhide__ = True
    from orchestrator.log.reader import read_log

    report = run_with_log(topology, source, "processes")
    log = report.directory / LOG
    if report.exit_code not in (exit_codes.PASSED, exit_codes.EXPECTATION_FAILED):
        raise _failed(topology, report.message, f"log up to there: {log}")
    held = read_log(log)
    trial = _trial(topology, gather(topology.plan, held.records()), held.departed)
    return trial, Record(log, trial.score)


def _failed(topology: Topology, message: str, log: str) -> TrialError:
    place = f"{topology.name} ({topology.path}), seed {topology.plan.seed}"
    return TrialError(f"{place}: {message}\n{log}")


def _trial(topology: Topology, gathered: Gathered, departed: Mapping[str, int] | None = None) -> Trial:
    return Trial(topology.plan.seed, *score_topology(topology, gathered, departed))
