"""One trial in this process, from the plan to its rows: no bus, no log, no file."""

from __future__ import annotations

import sys
import time
import traceback
from dataclasses import dataclass, replace

import numpy as np

from bus.inprocess import Sink
from bus.messages import Message, Truth
from bus.plan import Plan
from bus.program import NodeError
from orchestrator.backends.inprocess import run_carried
from orchestrator.evidence.rows import Row, failed_row, gathered_rows
from orchestrator.score.carried import Carried
from orchestrator.score.gather import Gatherer, ScoreError
from orchestrator.topology.resolved import Topology

_WINDOW = 1
"""Steps that the plant may lead: with one, the time between two truths is that of a step."""


@dataclass(frozen=True)
class TrialTiming:
    """Wall-clock facts of one trial (s): all of it with its score, and the percentiles of its steps.

    ``cpu_s`` is the processor time of its thread. The percentiles are NaN for a trial that failed before its
    third step.
    """

    wall_s: float
    cpu_s: float
    step_p50_s: float
    step_p95_s: float


def run_trial(plan: Plan, logged: Topology, trial: int) -> tuple[list[Row], TrialTiming]:
    """Run and score one trial; one that fails gives one row that says why, and a traceback on standard error.

    Parameters
    ----------
    plan
        What to run.
    logged
        The same topology as a log tells it, so that the score is that of a log.
    trial
        The trial's number.
    """
    begun = time.perf_counter(), time.thread_time()
    own = replace(plan, trial=trial)
    here = logged.at(trial=trial)
    gatherer = Gatherer(here.plan)
    carried = Carried(here.plan, gatherer)
    stamps: list[float] = []
    try:
        run_carried(own, _noting_steps(gatherer, stamps), carried.taker, _WINDOW)
        carried.complete()
        rows = gathered_rows(here, gatherer.finish())
    except Exception as error:
        print(f"{own.name}, trial {trial}:", file=sys.stderr)
        traceback.print_exc()
        told = isinstance(error, NodeError | ScoreError)
        rows = [failed_row(own, str(error) if told else f"{type(error).__name__}: {error}")]
    return rows, _timing(begun, stamps)


def _noting_steps(gatherer: Gatherer, stamps: list[float]) -> Sink:
    """Return a sink that gathers every message and notes when each step begins."""
    gather, clock = gatherer.take, time.perf_counter

    def take(topic: str, message: Message) -> None:
        if type(message) is Truth:
            stamps.append(clock())
        gather(topic, message)

    return take


def _timing(begun: tuple[float, float], stamps: list[float]) -> TrialTiming:
    wall_s, cpu_s = time.perf_counter() - begun[0], time.thread_time() - begun[1]
    steps = np.diff(stamps)
    p50, p95 = np.percentile(steps, [50.0, 95.0]).tolist() if steps.size > 1 else (np.nan, np.nan)
    return TrialTiming(wall_s, cpu_s, p50, p95)
