"""A run as arrays: one pass over its log, for the figures of one run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from bus.messages import ChannelEvents, Estimate, Message, Truth
from bus.plan import Plan
from orchestrator.log.reader import Log, read_log
from orchestrator.report.errors import ReportError
from orchestrator.score.gather import Bools, Floats, Ints, gather
from orchestrator.score.results import Score
from orchestrator.score.scoring import Evidence
from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology.resolved import Topology
from orchestrator.topology_score import score_topology

CHANNEL_COUNTS = ("sent", "delivered", "lost", "attacked", "injected", "refused")


@dataclass(frozen=True)
class Recording:
    """A run, read: N estimators, K steps that were recorded, n components of the state.

    ``truth`` (K, n). ``state`` and ``sigma`` (N, K, n) are what estimators said *of* a step (not in it).
    ``counts`` (6, K) are the packets of all links by step, in the order of `CHANNEL_COUNTS`. Unknown is NaN.
    K is less than the plan's ``steps`` where the record ends early.
    """

    log: Log
    topology: Topology
    score: Score
    evidence: Evidence
    truth: Floats
    state: Floats
    sigma: Floats
    counts: Ints

    @property
    def plan(self) -> Plan:
        """The plan of the run."""
        return self.topology.plan

    @property
    def names(self) -> list[str]:
        """The estimators' names, in the order of the arrays."""
        return [estimator.name for estimator in self.plan.estimators]

    @property
    def steps(self) -> int:
        """K: all steps up to the last one in which an estimate is recorded."""
        return len(self.truth)

    @property
    def attacked(self) -> Bools:
        """The steps (N, K) in which an attacked packet reached each estimator, or an attack the plant."""
        return self.evidence.attacked[:, : self.steps]

    @cached_property
    def norm(self) -> dict[str, Floats]:
        """The error norm (N, K) of what was estimated of each step, by state group."""
        return {group: self._of_steps(norm) for group, norm in self.evidence.errors.norm.items()}

    @cached_property
    def nees(self) -> Floats:
        """The NEES (N, K) of what was estimated of each step."""
        return self._of_steps(self.evidence.nees)

    @cached_property
    def alive(self) -> Bools:
        """Whether what was estimated of each step (N, K) was so before the estimator diverged."""
        return np.asarray(self._of_steps(self.evidence.errors.alive.astype(np.float64)) == 1.0)

    def _of_steps(self, values: Floats) -> Floats:
        """Return values by step of publication (N, all) by the step (N, K) that the estimate is of."""
        about = self.evidence.gathered.estimates.refers_to
        node, step = np.nonzero((about >= 0) & (about < self.steps))
        found = np.full((len(values), self.steps), np.nan)
        found[node, about[node, step]] = values[node, step]
        return found

    @property
    def components(self) -> list[str]:
        """Names for the components of the state: those of the groups of one, ``position 1``, or ``x 1``."""
        names = [f"x {index + 1}" for index in range(self.truth.shape[1])]
        for group, indices in self.topology.state_groups.items():
            for number, index in enumerate(indices, start=1):
                names[index] = group if len(indices) == 1 else f"{group} {number}"
        return names


class _Watch:
    """Takes what the score does not keep from a record that is passed on to it."""

    def __init__(self, plan: Plan) -> None:
        self.index = {estimator.name: i for i, estimator in enumerate(plan.estimators)}
        self.steps = plan.steps
        self.truth: dict[int, list[float]] = {}
        self.said: list[tuple[int, int, list[float], list[float]]] = []
        self.counts = np.zeros((len(CHANNEL_COUNTS), plan.steps), dtype=np.int64)

    def pass_on(self, records: Iterator[tuple[str, Message]]) -> Iterator[tuple[str, Message]]:
        """Yield all records, having looked at each."""
        for topic, message in records:
            if isinstance(message, Truth):
                self.truth[message.step] = message.state
            elif isinstance(message, Estimate):
                if message.state and 0 <= message.refers_to < self.steps:
                    node = self.index[topic.split("/")[1]]
                    self.said.append((node, message.refers_to, message.state, message.sigma))
            elif isinstance(message, ChannelEvents):
                self.counts[:, message.step] += [sum(getattr(message, name)) for name in CHANNEL_COUNTS]
            yield topic, message

    def arrays(self) -> tuple[Floats, Floats, Floats]:
        """Return truth, state and sigma."""
        n = len(next(iter(self.truth.values()), []))
        truth = np.full((self.steps, n), np.nan)
        for step, values in self.truth.items():
            truth[step] = values
        state, sigma = (np.full((len(self.index), self.steps, n), np.nan) for _ in range(2))
        for node, step, values, deviations in self.said:
            state[node, step] = values
            if len(deviations) == n:
                sigma[node, step] = deviations
        return truth, state, sigma


def read_recording(path: Path) -> Recording:
    """Read a run's log; raises `LogError` for anything else, `ReportError` for one that holds no estimate."""
    log = read_log(path)
    topology = topology_from_experiment(log.topology_json)
    watch = _Watch(topology.plan)
    gathered = gather(topology.plan, watch.pass_on(log.records()))
    result, evidence = score_topology(topology, gathered, log.departed)
    if not evidence.gathered.estimates.present.any():
        raise ReportError(f"{path} holds no estimate: there is nothing to report; run it again")
    steps = int(np.flatnonzero(evidence.gathered.estimates.present.any(axis=0))[-1]) + 1
    truth, state, sigma = watch.arrays()
    return Recording(
        log,
        topology,
        result,
        evidence,
        truth[:steps],
        state[:, :steps],
        sigma[:, :steps],
        watch.counts[:, :steps],
    )
