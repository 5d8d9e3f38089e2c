"""A jammer whose energy is bounded: it drowns links by chance, as long as it can afford it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt

from bus.packets import Packet
from bus.quantities import Probability
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import SteppedDraws, branch

Energy = Annotated[float, Ge(0.0)]


class JammerBattery:
    """Decides step by step whether to jam, and pays for it.

    It begins full with the first step of action. Its links ask for steps in any order; the one that is ahead
    goes through the steps of action one after another.
    """

    def __init__(
        self, generator: np.random.Generator, probability: float, budget: float, cost: float, recharge: float
    ) -> None:
        self._draw = SteppedDraws(generator).at
        self._probability = probability
        self._budget, self._cost, self._recharge = budget, cost, recharge
        self._energy = budget
        self._last: int | None = None
        self._jams: dict[int, bool] = {}

    def jams(self, step: int) -> bool:
        """Return whether it jams in a step of action."""
        decided = self._jams.get(step)
        return self._decide(step) if decided is None else decided

    def _decide(self, step: int) -> bool:
        if self._last is not None:
            gained = (step - self._last) * self._recharge
            self._energy = min(self._budget, self._energy + gained)
        self._last = step
        jams = self._draw(step) < self._probability and self._energy >= self._cost
        if jams:
            self._energy -= self._cost
        self._jams[step] = jams
        return jams


class Jammer:
    """Jams its links for a step at a time, as long as its energy lasts.

    Links that share a stream (``scope: shared``) have one jammer with one battery; otherwise each has its
    own. In the long run it jams at most ``recharge / cost`` of the steps.

    Parameters
    ----------
    probability
        The probability that it wants to jam a step.
    budget
        The energy that it begins with and can hold at most.
    cost
        The energy that a jammed step takes; it does not jam when there is less.
    recharge
        The energy that it gains a step.
    loss
        The probability that a slot is lost while jammed, independently over links and slots.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        budget: Energy,
        probability: Probability = 1.0,
        cost: Annotated[float, Gt(0.0)] = 1.0,
        recharge: Energy = 0.0,
        loss: Probability = 1.0,
    ) -> None:
        if budget < cost:
            raise ValueError(f"a budget of {budget:g} never affords a step of cost {cost:g}; raise 'budget'")
        if not math.isfinite(budget):
            raise ValueError("the budget is not finite; use a 'bernoulli' in a window instead")
        self._placement = placement
        self._loss = loss
        self._batteries = placement.by_link(
            lambda generator: JammerBattery(generator, probability, budget, cost, recharge)
        )

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        own = branch(self._placement.generators[self._placement.streams[link]], link)
        return _JammerLane(self._placement, link, self._batteries[link], own, self._loss)


class _JammerLane(Lane):
    def __init__(
        self,
        placement: Placement,
        link: str,
        battery: JammerBattery,
        generator: np.random.Generator,
        loss: float,
    ) -> None:
        super().__init__(placement, link)
        self._jams = battery.jams
        self._draw = SteppedDraws(generator).at
        self._loss = loss

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if not self._jams(slot.step) or self._draw(slot.number) >= self._loss:
            return packets
        for packet in packets:
            ledger.lost(self.link, self.label, packet)
        return ()
