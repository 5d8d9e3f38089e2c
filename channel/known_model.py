"""What an adversary was granted to know, as the matrices that attacks compute with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

Matrix = np.ndarray[tuple[int, int], np.dtype[np.float64]]


class KnownFilter(NamedTuple):
    """The steady-state filter of an estimator.

    ``sensors`` tells in which order measurements are stacked: the gain ``K`` (n, m) and the innovation
    covariance ``S`` (m, m) belong to it, and so do the measurement matrix ``C`` (m, n) and ``rows``, those
    of each sensor.
    """

    sensors: tuple[str, ...]
    K: Matrix
    S: Matrix
    C: Matrix
    rows: Mapping[str, slice]


class KnownModel:
    """The plant's matrices ``A`` (n, n) and ``B`` (n, p), its sensors and the filters that listen to them.

    Parameters
    ----------
    knowledge
        Nested lists by name, as a placement brings them.
    """

    def __init__(self, knowledge: Mapping[str, Any]) -> None:
        self.A: Matrix = np.array(knowledge["A"], dtype=np.float64)
        self.B: Matrix = np.array(knowledge["B"], dtype=np.float64).reshape(len(self.A), -1)
        self._measured = {
            name: np.array(model["C"], dtype=np.float64) for name, model in knowledge["sensors"].items()
        }
        self._filters: Mapping[str, Any] = knowledge.get("estimators", {})

    @property
    def sensors(self) -> tuple[str, ...]:
        """The names of all sensors."""
        return tuple(self._measured)

    def C(self, sensors: Sequence[str]) -> Matrix:
        """Return the measurement matrix (m, n) of sensors, one over the other; raises ValueError."""
        unknown = [name for name in sensors if name not in self._measured]
        if unknown or not sensors:
            raise ValueError(f"there is no sensor {', '.join(unknown)}; there is: {', '.join(self.sensors)}")
        return np.concatenate([self._measured[name] for name in sensors])

    def filter_of(self, estimator: str) -> KnownFilter:
        """Return the filter of an estimator; raises ValueError when it listens to no sensor."""
        known = self._filters.get(estimator)
        if known is None:
            raise ValueError(f"{estimator} is no estimator that listens to sensors; attack a link s1->e1")
        rows, begin = {}, 0
        for name in known["sensors"]:
            rows[name] = slice(begin, begin + len(self._measured[name]))
            begin = rows[name].stop
        return KnownFilter(
            tuple(known["sensors"]),
            np.array(known["K"], dtype=np.float64),
            np.array(known["S"], dtype=np.float64),
            self.C(known["sensors"]),
            rows,
        )
