"""What estimators say of a signal attack, beside the signal as it was: from messages to arrays.

An estimator speaks of signal attacks by diagnostics: ``attack_probability``, the estimate ``a0``, ``a1``, ...
of the signal given that there is one, and ``attack_step``, the step that both are about (the estimate's own
step when it is not said).
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bus.messages import Estimate, Truth
from nodes.published import Published

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


class _Places(NamedTuple):
    """Where a list of diagnostics holds what is said of attacks; -1 where it is not said."""

    probability: int
    step: int
    values: tuple[int, ...]


class AttackListener:
    """Takes truth and estimates in any order."""

    def __init__(self) -> None:
        self._truth: dict[int, list[float]] = {}
        self._layouts: dict[int, tuple[list[str], _Places | None]] = {}
        self._said = array("q")  # node, step, number of values
        self._about, self._probability, self._values = array("d"), array("d"), array("d")

    def take_truth(self, message: Truth) -> None:
        """Keep the signal of a step."""
        self._truth[message.step] = message.attack

    def take_estimate(self, node: int, message: Estimate | Published) -> None:
        """Keep what an estimate says of the attack."""
        names, places = self._layouts.get(node, ([], None))
        if names != message.diagnostic_name:
            places = _places(message.diagnostic_name)
            self._layouts[node] = (message.diagnostic_name, places)
        if places is None:
            return
        said = message.diagnostic_value
        self._said.extend((node, message.step, len(places.values)))
        self._about.append(said[places.step] if places.step >= 0 else message.refers_to)
        self._probability.append(said[places.probability] if places.probability >= 0 else np.nan)
        self._values.extend(said[place] for place in places.values)

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


def _places(names: Sequence[str]) -> _Places | None:
    """Return where what is said of attacks stands among some diagnostics; None when nothing is."""
    place = {name: at for at, name in enumerate(names)}
    values = []
    for i in count():
        if f"a{i}" not in place:
            break
        values.append(place[f"a{i}"])
    if PROBABILITY not in place and not values:
        return None
    return _Places(place.get(PROBABILITY, -1), place.get(STEP, -1), tuple(values))
