"""Estimates of a record: from what estimators published to arrays by estimator and step."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from bus.messages import Estimate
from bus.packets import Vector
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


class EstimateRows:
    """Estimates in the making, in any order; what they say of packets goes to the rows of verdicts.

    ``incoming`` gives by node the links into it, by their source. ``index`` numbers the estimators.
    """

    def __init__(self, plan: Plan, incoming: Mapping[str, Index], verdicts: Rows) -> None:
        self._plan = plan
        self._incoming = incoming
        self._verdicts = verdicts
        self.index = Index({estimator.name: i for i, estimator in enumerate(plan.estimators)})
        self._loose: list[tuple[str, Estimate]] = []
        self._numbers = array("q")  # rows of seven, see `_pack`
        self._state, self._covariance, self._nis = array("d"), array("d"), array("d")

    def take(self, name: str, message: Estimate) -> None:
        """Take an estimate as a message."""
        self._loose.append((name, message))
        if len(self._loose) >= MOST_LOOSE:
            self._pack()

    def take_beliefs(self, name: str, beliefs: Sequence[Published]) -> None:
        """Take many estimates of one estimator as it made them."""
        node, incoming, rows = self.index[name], self._incoming[name], self._verdicts
        for own in beliefs:
            sizes = own.state.size, own.covariance.size
            self._numbers.extend((node, own.step, own.refers_to, own.diverged, own.nis_dof, *sizes))
        self._nis.extend([own.nis for own in beliefs])
        self._state.frombytes(_bytes([own.state for own in beliefs]))
        self._covariance.frombytes(_bytes([own.covariance.ravel() for own in beliefs]))
        detections = [detection for own in beliefs for detection in own.detections]
        rows.link.extend([incoming[detection.source] for detection in detections])
        rows.step.extend([own.step for own in beliefs for _ in own.detections])
        rows.sequence.extend([detection.sequence for detection in detections])
        rows.mark.extend([bool(detection.alarm) for detection in detections])
        rows.value.extend([detection.statistic for detection in detections])

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
        (K, n), N = truth.shape, len(self._plan.estimators)
        self._check(node, step, size, covariance_size, n)
        present, declared = np.zeros((N, K), dtype=bool), np.zeros((N, K), dtype=bool)
        present[node, step] = True
        declared[node, step] = diverged.astype(bool)
        nis, nis_dof = np.full((N, K), np.nan), np.zeros((N, K), dtype=np.int64)
        nis[node, step], nis_dof[node, step] = np.array(self._nis), dof
        error, covariance = np.full((N, K, n), np.nan), np.full((N, K, n, n), np.nan)
        has = size > 0
        known = (refers_to >= 0) & (refers_to < K)
        reference = np.where(known[:, None], truth[np.where(known, refers_to, 0)], np.nan)
        state = np.full((N, K, n), np.nan)
        state[node[has], step[has]] = np.array(self._state).reshape(has.sum(), n)
        error[node[has], step[has]] = state[node[has], step[has]] - reference[has]
        refers = np.full((N, K), -1)
        refers[node, step] = refers_to
        has = covariance_size > 0
        covariance[node[has], step[has]] = np.array(self._covariance).reshape(has.sum(), n, n)
        return Estimates(present, declared, refers, state, error, covariance, nis, nis_dof)


def _bytes(arrays: list[Vector]) -> bytes:
    return np.concatenate(arrays, dtype=np.float64).tobytes() if arrays else b""
