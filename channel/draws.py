"""Uniform draws that are addressed by step, however late or out of turn they are asked for."""

from __future__ import annotations

import numpy as np

_BLOCK = 256


class SteppedDraws:
    """One uniform number on [0, 1) for every step of a stream.

    Drawn ahead in blocks: a generator's call costs more than the number. Links that share a stream may ask
    for steps in any order and meet the same numbers.
    """

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._drawn: list[float] = []

    def at(self, step: int) -> float:
        """Return the draw of a step."""
        while step >= len(self._drawn):
            self._drawn += self._generator.random(_BLOCK).tolist()
        return self._drawn[step]
