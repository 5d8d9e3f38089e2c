"""Estimates of a record: from what estimators published to arrays by estimator and step."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np

from bus.messages import Estimate
from bus.plan import Plan
from nodes.published import Published
from orchestrator.score.columns import (
    MOST_LOOSE,
    Bools,
    Floats,
    Index,
    Ints,
    Rows,
    ScoreError,
    integers,
)


@dataclass(frozen=True)
class Estimates:
    """Estimates by (estimator, step of publication), N x K, in the plan's order; NaN where unknown.

    ``state`` (N, K, n) is what was estimated of the step ``refers_to`` (N, K), ``error`` (N, K, n) that less
    the truth of that step. ``covariance`` is (N, K, n, n).
    """

    present: Bools
    declared_diverged: Bools
    refers_to: Ints
    state: Floats
    error: Floats
    covariance: Floats
    nis: Floats
    nis_dof: Ints


class _Table:
    """Estimates by (estimator, step) in the making, N x K; of n state components once that is known."""

    def __init__(self, estimators: int, steps: int) -> None:
        size = estimators, steps
        self.present, self.declared_diverged = np.zeros(size, dtype=bool), np.zeros(size, dtype=bool)
        self.refers_to, self.nis_dof = np.full(size, -1), np.zeros(size, dtype=np.int64)
        self.nis = np.full(size, np.nan)
        self.state: Floats = np.zeros((*size, 0))
        self.covariance: Floats = np.zeros((*size, 0, 0))

    def hold(self, n: int) -> None:
        """Make room for states of n components, where there is none."""
        if self.state.shape[2] < n:
            self.state = np.full((*self.nis.shape, n), np.nan)
            self.covariance = np.full((*self.nis.shape, n, n), np.nan)

    def estimates(self, truth: Floats) -> Estimates:
        """Return them, beside the truth (K, n)."""
        known = (self.refers_to >= 0) & (self.refers_to < len(truth))
        reference = np.where(known[:, :, None], truth[np.where(known, self.refers_to, 0)], np.nan)
        return Estimates(
            self.present,
            self.declared_diverged,
            self.refers_to,
            self.state,
            self.state - reference,
            self.covariance,
            self.nis,
            self.nis_dof,
        )


class EstimateRows:
    """Estimates in the making, in any order; what they say of packets goes to the rows of verdicts.

    ``incoming`` gives by node the links into it, by their source. ``index`` numbers the estimators.
    """

    def __init__(self, plan: Plan, incoming: Mapping[str, Index], verdicts: Rows) -> None:
        self._plan = plan
        self._incoming = incoming
        self._verdicts = verdicts
        self.index = Index({estimator.name: i for i, estimator in enumerate(plan.estimators)})
        self._table = _Table(len(plan.estimators), plan.steps)
        self._loose: list[tuple[str, Estimate]] = []
        self._numbers = array("q")  # rows of seven, see `_pack`
        self._state, self._covariance, self._nis = array("d"), array("d"), array("d")

    def take(self, name: str, message: Estimate) -> None:
        """Take an estimate as a message."""
        self._loose.append((name, message))
        if len(self._loose) >= MOST_LOOSE:
            self._pack()

    def taker(self, name: str) -> Callable[[Published], None]:
        """Return what takes the estimates of one estimator as it makes them, one of each step."""
        node, incoming, rows = self.index[name], self._incoming[name], self._verdicts
        table = self._table
        present, declared = table.present[node], table.declared_diverged[node]
        refers_to, nis, nis_dof = table.refers_to[node], table.nis[node], table.nis_dof[node]
        state = covariance = np.zeros((0, 0))
        link, at, number = rows.link.append, rows.step.append, rows.sequence.append
        mark, value = rows.mark.append, rows.value.append

        def take(own: Published) -> None:
            nonlocal state, covariance
            step, believed = own.step, own.state
            present[step] = True
            refers_to[step] = own.refers_to
            nis[step], nis_dof[step] = own.nis, own.nis_dof
            if not believed.size:
                declared[step] = True
            else:
                if not state.size:
                    table.hold(believed.size)
                    state, covariance = table.state[node], table.covariance[node]
                state[step], covariance[step] = believed, own.covariance
            for detection in own.detections:
                link(incoming[detection.source])
                at(step)
                number(detection.sequence)
                mark(bool(detection.alarm))
                value(detection.statistic)

        return take

    def _pack(self) -> None:
        """Pack the estimates' numbers; of many at once, for that takes a third of the time."""
        messages = [message for _, message in self._loose]
        nodes = [self.index[name] for name, _ in self._loose]
        columns: tuple[list[int], ...] = (
            nodes,
            [message.step for message in messages],
            [message.refers_to for message in messages],
            [message.diverged for message in messages],
            [message.nis_dof for message in messages],
            [len(message.state) for message in messages],
            [len(message.covariance) for message in messages],
        )
        self._numbers.extend(chain.from_iterable(zip(*columns, strict=True)))
        self._nis.extend([message.nis for message in messages])
        self._state.extend(chain.from_iterable([message.state for message in messages]))
        self._covariance.extend(chain.from_iterable([message.covariance for message in messages]))
        judging = [(self._incoming[name], own) for name, own in self._loose if own.detector_source]
        rows = self._verdicts
        rows.link.extend([links[source] for links, own in judging for source in own.detector_source])
        rows.step.extend([own.step for _, own in judging for _ in own.detector_source])
        rows.sequence.extend([number for _, own in judging for number in own.detector_sequence])
        rows.mark.extend([alarm for _, own in judging for alarm in own.detector_alarm])
        rows.value.extend([value for _, own in judging for value in own.detector_statistic])
        self._loose.clear()

    def _check(self, node: Ints, step: Ints, size: Ints, covariance_size: Ints, n: int) -> None:
        names = (*(estimator.name for estimator in self._plan.estimators), "an unknown estimator")
        faults = {
            "stands outside the plan": (node < 0) | (step < 0) | (step >= self._plan.steps),
            f"has a state of another size than the plant's {n}": (size != 0) & (size != n),
            f"has a covariance that is not {n} x {n}": (covariance_size != 0) & (covariance_size != n * n),
        }
        place = node * self._plan.steps + step
        first = np.zeros(place.size, dtype=bool)
        first[np.unique(place, return_index=True)[1]] = True
        faults["stands in the record twice"] = ~first
        for fault, where in faults.items():
            if where.any():
                at = int(np.argmax(where))
                raise ScoreError(f"the estimate of {names[node[at]]} at step {step[at]} {fault}")

    def finish(self, truth: Floats) -> Estimates:
        """Return all that was taken, beside the truth (K, n); raises `ScoreError` for what cannot be."""
        self._pack()
        rows = integers(self._numbers).reshape(-1, 7)
        node, step, refers_to, diverged, dof, size, covariance_size = rows.T.copy()
        n, table = truth.shape[1], self._table
        self._check(node, step, size, covariance_size, n)
        table.hold(n)
        table.present[node, step] = True
        table.declared_diverged[node, step] = diverged.astype(bool)
        table.refers_to[node, step] = refers_to
        table.nis[node, step], table.nis_dof[node, step] = np.array(self._nis), dof
        has = size > 0
        table.state[node[has], step[has]] = np.array(self._state).reshape(has.sum(), n)
        has = covariance_size > 0
        table.covariance[node[has], step[has]] = np.array(self._covariance).reshape(has.sum(), n, n)
        return table.estimates(truth)
