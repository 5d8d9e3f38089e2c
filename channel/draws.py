"""Random draws that are addressed by step or slot, however late or out of turn they are asked for."""

from __future__ import annotations

import hashlib
import math
from bisect import bisect_left
from collections.abc import Callable
from typing import Annotated, Any, Generic, TypeVar

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from bus.packets import Vector

_BLOCK, _MOST = 256, 4096
_SLOT_WORD, _BRANCH_WORD = 2, 3  # of the counter's four 64-bit words; blocks drawn in sequence reach neither

Law = Callable[[np.random.Generator, int], NDArray[Any]]
"""Draws a block of a given size from a generator."""

Correlation = Annotated[float, Interval(ge=0.0, lt=1.0)]
"""Of the normal numbers from which fates of successive steps are made: a Gaussian copula."""

T = TypeVar("T")


class SteppedFates(Generic[T]):
    """One value of a law for every step (or slot) of a stream, made ahead in blocks that grow.

    What a law draws must not depend on the sizes of its blocks, which are multiples of 256; one that keeps a
    state from block to block must be a stream's own. Links that share a stream may ask for steps in any order
    and meet the same values.
    """

    def __init__(self, generator: np.random.Generator, law: Law) -> None:
        self._generator = generator
        self._law = law
        self._made: list[T] = []
        self._happens: list[int] = []

    def at(self, step: int) -> T:
        """Return the value of a step."""
        try:
            return self._made[step]
        except IndexError:
            self._make(step)
            return self._made[step]

    def next(self, step: int) -> int:
        """Return the first step from the given one on whose value is not zero, as far as values are made."""
        if step >= len(self._made):
            self._make(step)
        place = bisect_left(self._happens, step)
        return self._happens[place] if place < len(self._happens) else len(self._made)

    def _make(self, step: int) -> None:
        while step >= len(self._made):
            size = min(max(_BLOCK, len(self._made)), _MOST)
            block = self._law(self._generator, size)
            self._happens += (np.flatnonzero(block) + len(self._made)).tolist()
            self._made += block.tolist()


class SteppedDraws(SteppedFates[float]):
    """One uniform number on [0, 1) for every step (or slot) of a stream."""

    def __init__(self, generator: np.random.Generator) -> None:
        super().__init__(generator, np.random.Generator.random)


class CorrelatedNormals:
    """A law of standard normal numbers, each correlated with the one before: an autoregression.

    ``z[k] = correlation * z[k - 1] + sqrt(1 - correlation^2) * w[k]``, begun in its stationary law, so that
    every number is exactly standard normal.
    """

    def __init__(self, correlation: float) -> None:
        self._correlation = correlation
        self._innovation = math.sqrt(1.0 - correlation**2)
        self._last: float | None = None

    def __call__(self, generator: np.random.Generator, size: int) -> Vector:
        """Return the next numbers (size,)."""
        drawn: Vector = generator.standard_normal(size)
        if self._correlation == 0.0:
            return drawn
        numbers = []
        last = self._last
        for normal in drawn.tolist():
            last = normal if last is None else self._correlation * last + self._innovation * normal
            numbers.append(last)
        self._last = last
        return np.array(numbers)


def tail(normals: Vector) -> Vector:
    """Return P(Z > z) of standard normal numbers: exactly uniform on [0, 1], and the higher the lower z."""
    return np.array([0.5 * math.erfc(normal * math.sqrt(0.5)) for normal in normals.tolist()])


def correlated_uniforms(correlation: float) -> Law:
    """Return a law of uniform numbers, tied to one another by a Gaussian copula; 0 makes them independent.

    ``correlation`` is that of the normal numbers beneath; the uniform ones have
    ``6 / pi * asin(correlation / 2)``, which is a little less.
    """
    if correlation == 0.0:
        return np.random.Generator.random
    normals = CorrelatedNormals(correlation)
    return lambda generator, size: tail(normals(generator, size))


def chances(generator: np.random.Generator, probability: float, correlation: float) -> SteppedFates[bool]:
    """Return whether each step is one of those that happen with a probability, correlated over steps."""
    uniforms = correlated_uniforms(correlation)
    return SteppedFates(generator, lambda source, size: uniforms(source, size) < probability)


def branch(generator: np.random.Generator, name: str) -> np.random.Generator:
    """Return a further generator of a stream, for something that has a name of its own in it.

    It draws nothing that the stream itself or a branch of another name draws.
    """
    counter = np.zeros(4, dtype=np.uint64)
    digest = hashlib.blake2b(name.encode(), digest_size=8).digest()
    counter[_BRANCH_WORD] = int.from_bytes(digest, "little") | 1
    return np.random.Generator(np.random.Philox(key=_philox(generator)["key"], counter=counter))


def _philox(generator: np.random.Generator) -> dict[str, NDArray[np.uint64]]:
    """Return key and counter of a stream's generator."""
    state = generator.bit_generator.state
    if state["bit_generator"] != "Philox":
        raise ValueError("draws are addressed by the counter of a Philox generator")
    return {name: words.copy() for name, words in state["state"].items()}


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
    """Numbers of its own for every slot of a stream: for kinds that draw a varying number of them.

    Slots may be asked for in any order and any number of times. What is drawn in sequence from the stream's
    own generator is never drawn here.
    """

    def __init__(self, generator: np.random.Generator) -> None:
        philox = _philox(generator)
        self._bits = np.random.Philox(key=philox["key"])
        self._state = self._bits.state
        self._counter = self._state["state"]["counter"]
        self._counter[_BRANCH_WORD] = philox["counter"][_BRANCH_WORD]
        self._generator = np.random.Generator(self._bits)

    def at(self, slot: int) -> np.random.Generator:
        """Return the generator of a slot; it is good until that of another slot is asked for.

        There is one, whose counter is set: a new one costs ten times as much.
        """
        self._counter[_SLOT_WORD] = slot + 1
        self._bits.state = self._state
        return self._generator


def permutation(draw: float, size: int) -> list[int]:
    """Return the permutation of so many things that a uniform number on [0, 1) stands for."""
    left = list(range(size))
    order = []
    for count in range(size, 0, -1):
        draw *= count
        place = min(int(draw), count - 1)
        draw -= place
        order.append(left.pop(place))
    return order
