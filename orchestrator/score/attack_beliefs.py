"""What estimators say of a signal attack, beside the signal as it was: from messages to arrays.

An estimator speaks of signal attacks by diagnostics: ``attack_probability``, the estimate ``a0``, ``a1``, ...
of the signal given that there is one, and ``attack_step``, the step that both are about (the estimate's own
step when it is not said).
"""

from __future__ import annotations

from array import array
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import count, takewhile

import numpy as np
from numpy.typing import NDArray

from bus.messages import Truth

PROBABILITY = "attack_probability"
STEP = "attack_step"


@dataclass(frozen=True)
class AttackBeliefs:
    """Statements by (estimator, step of publication), N x K, in the plan's order.

    ``signal`` (K, q) is the signal of each step, zero where there was none and NaN where its truth is
    missing. ``about`` (N, K) is the step that a statement is about, -1 where there is none or the run has no
    such step; ``probability`` (N, K) and ``value`` (N, K, q) are NaN where nothing was said, or something of
    another size than the signal's.
    """

    signal: NDArray[np.float64]
    about: NDArray[np.int64]
    probability: NDArray[np.float64]
    value: NDArray[np.float64]

    @property
    def on(self) -> NDArray[np.bool_]:
        """Whether there was an attack, (K,): the signal is not zero."""
        return np.asarray(np.nan_to_num(self.signal).any(axis=1))

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether the truth of a step is there, (K,)."""
        return np.asarray(np.isfinite(self.signal).all(axis=1))


class AttackListener:
    """Takes truth and estimates in any order."""

    def __init__(self) -> None:
        self._truth: dict[int, list[float]] = {}
        self._of_signal: dict[tuple[str, ...], tuple[str, ...]] = {}
        """The names of the components of a signal, among the names of diagnostics."""
        self._said = array("q")  # node, step, number of values
        self._about, self._probability, self._values = array("d"), array("d"), array("d")

    def take_truth(self, message: Truth) -> None:
        """Keep the signal of a step."""
        self._truth[message.step] = message.attack

    def take_diagnostics(self, node: int, step: int, refers_to: int, said: Mapping[str, float]) -> None:
        """Keep what an estimate's diagnostics say of the attack."""
        names = tuple(said)
        components = self._of_signal.get(names)
        if components is None:
            components = self._of_signal[names] = _components(names)
        if components or PROBABILITY in said:
            self._said.extend((node, step, len(components)))
            self._about.append(said.get(STEP, refers_to))
            self._probability.append(said.get(PROBABILITY, np.nan))
            self._values.extend([said[name] for name in components])

    def beliefs(self, estimators: int, steps: int) -> AttackBeliefs:
        """Return what was heard, of so many estimators and steps."""
        q = max(map(len, self._truth.values()), default=0)
        signal = np.full((steps, q), np.nan)
        for at, entered in self._truth.items():
            signal[at] = entered
        about = np.full((estimators, steps), -1)
        probability = np.full((estimators, steps), np.nan)
        value = np.full((estimators, steps, q), np.nan)
        node, step, size = np.array(self._said, dtype=np.int64).reshape(-1, 3).T
        of_step = np.array(self._about)
        about[node, step] = np.where((of_step >= 0) & (of_step < steps), of_step, -1.0).astype(np.int64)
        probability[node, step] = np.array(self._probability)
        fits = (size == q) & (size > 0)
        values = np.array(self._values)[np.repeat(fits, size)]
        value[node[fits], step[fits]] = values.reshape(int(fits.sum()), q)
        return AttackBeliefs(signal, about, probability, value)


def _components(names: Collection[str]) -> tuple[str, ...]:
    """Return the diagnostics called ``a0``, ``a1`` and so on, as far as they go."""
    return tuple(takewhile(names.__contains__, (f"a{i}" for i in count())))
