"""Random draws that are addressed by step or slot, however late or out of turn they are asked for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bus.packets import Vector

_BLOCK = 256
_SLOT_WORD = 2  # of the counter's four 64-bit words; blocks drawn in sequence never reach it


class SteppedDraws:
    """One uniform number on [0, 1) for every step (or slot) of a stream.

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


class SteppedVectors:
    """One vector of draws for every step of a stream, all of the size that is first asked for.

    ``law`` draws an array of a given shape from a generator.
    """

    def __init__(
        self,
        generator: np.random.Generator,
        law: Callable[[np.random.Generator, tuple[int, int]], np.ndarray] = np.random.Generator.random,
    ) -> None:
        self._generator = generator
        self._law = law
        self._blocks: list[np.ndarray] = []

    def at(self, step: int, size: int) -> Vector:
        """Return the draws (size,) of a step; raises ValueError when the size is another than before."""
        block, row = divmod(step, _BLOCK)
        while block >= len(self._blocks):
            self._blocks.append(self._law(self._generator, (_BLOCK, size)))
        vector: Vector = self._blocks[block][row]
        if vector.size != size:
            raise ValueError(f"the payload had {vector.size} values before, and has {size} now")
        return vector


class SlotStreams:
    """A generator of its own for every slot of a stream: for kinds that draw a varying number of numbers.

    Slots may be asked for in any order and any number of times. What is drawn in sequence from the stream's
    own generator is never drawn here.
    """

    def __init__(self, generator: np.random.Generator) -> None:
        state = generator.bit_generator.state
        if state["bit_generator"] != "Philox":
            raise ValueError("slots are addressed by the counter of a Philox generator")
        self._key = state["state"]["key"].copy()

    def at(self, slot: int) -> np.random.Generator:
        """Return the generator of a slot."""
        counter = np.zeros(4, dtype=np.uint64)
        counter[_SLOT_WORD] = slot + 1
        return np.random.Generator(np.random.Philox(key=self._key, counter=counter))
