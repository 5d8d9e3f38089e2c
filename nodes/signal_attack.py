"""Attacks on the plant and its sensors themselves: an unknown signal in the dynamics and the outputs.

``x+ = A x + B u + G a + w`` and ``y = C x + H a + v`` (Forti et al. 2019, eqs (1), (2)): the plant's model
brings ``G`` and the sensors' models ``H``; the signal ``a`` is the same for all of them.
"""

from __future__ import annotations

import numpy as np

from bus.kinds import load_class
from bus.packets import Vector
from bus.plan import Plan
from bus.random_streams import random_stream
from bus.schedules import Timing
from nodes.gaussian import Deviation


class Signal:
    """A signal (q,) that is constant while it acts, or follows a series.

    Parameters
    ----------
    generator
        Its random stream.
    value
        The constant value, one number for each component of the signal.
    series
        Instead: its values by row, the first in the first step of its window; the last one stays.
    noise_std
        Standard deviation of white Gaussian noise that is added to each component.
    """

    def __init__(
        self,
        generator: np.random.Generator,
        *,
        value: list[float] | None = None,
        series: list[list[float]] | None = None,
        noise_std: Deviation = 0.0,
    ) -> None:
        if (value is None) == (not series):
            raise ValueError("give exactly one of 'value' and 'series'")
        rows = [value] if value is not None else series or []
        if len({len(row) for row in rows}) > 1 or not rows[0]:
            raise ValueError("the rows of 'series' must be of one length, at least 1")
        if not noise_std >= 0.0:
            raise ValueError("noise_std must not be negative")
        self._rows = np.array(rows, dtype=np.float64)
        self._noise_std = noise_std
        self._generator = generator
        self._noise: list[Vector] = []
        self.size = len(rows[0])

    def at(self, since: int, step: int) -> Vector:
        """Return the value (q,) in a step, ``since`` steps after the first of its window."""
        value: Vector = self._rows[min(since, len(self._rows) - 1)]
        if self._noise_std == 0.0:
            return value
        while step >= len(self._noise):
            self._noise.append(self._noise_std * self._generator.standard_normal(self.size))
        return value + self._noise[step]


class SignalAttacks:
    """The sum of all signal attacks of a plan; plant and sensors each compute the same."""

    def __init__(self, plan: Plan) -> None:
        self._signals = [
            (
                Timing(plan, signal.timing),
                load_class(signal.kind.reference)(
                    random_stream(plan.seed, plan.trial, signal.label, signal.purpose),
                    **signal.kind.parameters,
                ),
            )
            for signal in plan.signals
        ]
        self.exist = bool(self._signals)
        sizes = {signal.size for _, signal in self._signals}
        if len(sizes) > 1:
            raise ValueError(f"signal attacks on one plant must have as many components: {sorted(sizes)}")
        self._zero: Vector = np.zeros(sizes.pop() if sizes else 0)

    def at(self, step: int) -> Vector:
        """Return the signal (q,) of a step, zero when nobody acts."""
        value = self._zero
        for timing, signal in self._signals:
            if timing.active(step):
                value = value + signal.at(step - timing.first, step)
        return value
