"""Delay and jitter: packets that reach a later slot than that of their step."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from bus.packets import Packet, Vector
from bus.quantities import Probability
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import CorrelatedNormals, Correlation, Law, SteppedFates, branch, tail

Steps = Annotated[float, Ge(0.0)]
Distribution = Literal["constant", "uniform", "normal", "pareto"]

_LONGEST = 2.0**53


def _pareto(shape: float) -> Callable[[Vector], Vector]:
    """Return the quantile function, of upper tails, of a Pareto law with mean 0 and variance 1."""
    mean = shape / (shape - 1.0)
    spread = math.sqrt(shape / (shape - 2.0)) / (shape - 1.0)
    return lambda normals: (tail(normals) ** (-1.0 / shape) - mean) / spread


def delays(
    delay: float, jitter: float, distribution: Distribution, correlation: float, shape: float = 3.0
) -> Law:
    """Return the law of delays in steps, before they are rounded down; negative draws are cut to 0."""
    normals = CorrelatedNormals(correlation)
    deviations: dict[Distribution, Callable[[Vector], Vector]] = {
        "constant": np.zeros_like,
        "uniform": lambda drawn: 1.0 - 2.0 * tail(drawn),
        "normal": lambda drawn: drawn,
        "pareto": _pareto(shape),
    }
    deviation = deviations[distribution if jitter else "constant"]

    def law(generator: np.random.Generator, size: int) -> Vector:
        drawn: Vector = np.clip(delay + jitter * deviation(normals(generator, size)), 0.0, _LONGEST)
        return drawn

    return law


def skips(probability: float, gap: int) -> Law:
    """Return whether each step's packets overtake: with a probability, once ``gap - 1`` steps did not."""
    since = 0

    def law(generator: np.random.Generator, size: int) -> NDArray[np.bool_]:
        nonlocal since
        fates = []
        for draw in generator.random(size).tolist():
            skip = since >= gap - 1 and draw < probability
            since = 0 if skip else since + 1
            fates.append(skip)
        return np.array(fates)

    return law


class Delay:
    """Keeps packets: one that was sent in step k reaches the slot of step k + floor(delay), of its round.

    All packets of a step on a link share one draw, whatever their number. A packet whose delay is shorter
    than that of one before it overtakes it.

    Parameters
    ----------
    delay
        Mean delay (steps), before negative draws are cut to 0.
    jitter
        Spread of the delay (steps): half the width of the uniform law, the standard deviation of the others.
    distribution
        The law of the delay; without jitter every one is constant.
    correlation
        Of the normal numbers from which delays of successive steps are made (a Gaussian copula); for the
        normal law it is the delays' own. The law of each delay stays exact.
    shape
        The exponent of the Pareto law's tail.
    reorder
        The probability that a step's packets skip the delay.
    gap
        Packets skip at the earliest in the ``gap``-th step after the last that did.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        delay: Steps,
        jitter: Steps = 0.0,
        distribution: Distribution = "uniform",
        correlation: Correlation = 0.0,
        shape: Annotated[float, Gt(2.0)] = 3.0,
        reorder: Probability = 0.0,
        gap: Annotated[int, Ge(1)] = 1,
    ) -> None:
        if distribution == "constant" and jitter:
            raise ValueError("a constant delay has no jitter; leave out 'jitter' or 'distribution'")
        if gap > 1 and not reorder:
            raise ValueError("'gap' spaces what 'reorder' lets overtake; give 'reorder', or leave 'gap' out")
        self._placement = placement

        def whole_steps(generator: np.random.Generator) -> SteppedFates[int]:
            drawn = delays(delay, jitter, distribution, correlation, shape)
            overtakes, own = skips(reorder, gap), branch(generator, "reorder")

            def law(source: np.random.Generator, size: int) -> NDArray[np.int64]:
                steps = drawn(source, size).astype(np.int64)
                return np.where(overtakes(own, size), 0, steps) if reorder else steps

            return SteppedFates(generator, law)

        self._delays = placement.by_link(whole_steps)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _DelayLane(self._placement, link, self._delays[link])


class _DelayLane(Lane):
    def __init__(self, placement: Placement, link: str, delays: SteppedFates[int]) -> None:
        super().__init__(placement, link)
        self._delay = delays.at
        self._next = delays.next
        self._waiting: dict[tuple[int, int], list[Packet]] = {}

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        delay = self._delay(slot.step)
        if delay and packets:
            self._waiting.setdefault((slot.step + delay, slot.round), []).extend(packets)
            self.held += len(packets)
            for packet in packets:
                ledger.delayed(self.link, self.label, packet, delay)
            packets = ()
        return self.rest(slot, packets, ledger) if self._waiting else packets

    def rest(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        due = self._waiting.pop((slot.step, slot.round), None)
        if due is None:
            return packets
        self.held -= len(due)
        return (*due, *packets)

    def quiet_until(self, step: int) -> int:
        return self._next(step)
