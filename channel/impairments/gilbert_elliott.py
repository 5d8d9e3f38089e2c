"""Bursty losses: a link that is in a good or in a bad state.

Sources: Gilbert (1960), Elliott (1963); the failure and recovery rates are named as by Ding et al. (2021),
eq. (2): with the good state called 1 and the bad one 0, failure is P(1 -> 0) and recovery P(0 -> 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from bus.packets import Packet
from bus.quantities import Probability
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import SteppedFates

Clock = Literal["step", "slot", "packet"]
Initial = Literal["good", "bad", "stationary"]
LossFrom = Literal["new_state", "old_state"]

_TOGETHER = 256


@dataclass(frozen=True)
class GilbertElliottLaw:
    """The two-state chain: transition and loss probabilities, and its conventions."""

    failure: float
    recovery: float
    loss_good: float = 0.0
    loss_bad: float = 1.0
    initial: Initial = "good"
    loss_from: LossFrom = "new_state"

    @property
    def stationary_bad(self) -> float:
        """The share of ticks in the bad state; a chain that never moves stays as it began."""
        total = self.failure + self.recovery
        return self.failure / total if total > 0.0 else float(self.initial == "bad")

    @property
    def stationary_loss(self) -> float:
        """The share of ticks that lose."""
        return self.stationary_bad * self.loss_bad + (1.0 - self.stationary_bad) * self.loss_good


def law_of_bursts(
    mean_loss: float, mean_burst: float, initial: Initial, loss_from: LossFrom
) -> GilbertElliottLaw:
    """Return the chain that loses in its bad state only, by its share of losses and mean length of a burst.

    A burst's length is geometric with mean 1 / recovery. Raises ValueError when no such chain exists.
    """
    if mean_loss >= 1.0:
        raise ValueError("mean_loss must be below 1")
    recovery = 1.0 / mean_burst
    failure = recovery * mean_loss / (1.0 - mean_loss)
    if failure > 1.0:
        least = mean_loss / (1.0 - mean_loss)
        raise ValueError(f"mean_loss {mean_loss} needs bursts of mean_burst {least:.6g} or more")
    return GilbertElliottLaw(failure, recovery, initial=initial, loss_from=loss_from)


class GilbertElliottChain(SteppedFates[bool]):
    """The fates of one chain: `at` tells whether a tick loses; ticks may be asked for in any order."""

    def __init__(self, law: GilbertElliottLaw, generator: np.random.Generator) -> None:
        super().__init__(generator, self._walk)
        first = generator.random()
        self._chain = law
        self._bad = law.initial == "bad" if law.initial != "stationary" else first < law.stationary_bad

    def _walk(self, generator: np.random.Generator, size: int) -> NDArray[np.bool_]:
        """Return the fates of the next ticks; the draws of each so many ticks stand together."""
        law = self._chain
        draws = [generator.random((2, _TOGETHER)) for _ in range(size // _TOGETHER)]
        moves, losses = np.concatenate(draws, axis=1)
        moved = states_bad(moves < law.failure, moves >= law.recovery, self._bad)
        deciding = moved if law.loss_from == "new_state" else np.append(self._bad, moved[:-1])
        self._bad = bool(moved[-1])
        lost: NDArray[np.bool_] = losses < np.where(deciding, law.loss_bad, law.loss_good)
        return lost


def states_bad(from_good: NDArray[np.bool_], from_bad: NDArray[np.bool_], bad: bool) -> NDArray[np.bool_]:
    """Return whether a chain is bad after each tick, given whether it leads there from good, and from bad.

    A tick that leads to one state from both forgets all before it; since the last such one, only the number
    of ticks that exchange the states counts.
    """
    forgets = from_good == from_bad
    last = np.maximum.accumulate(np.where(forgets, np.arange(forgets.size), -1))
    exchanges = np.cumsum(from_good & ~from_bad)
    known = last >= 0
    begun = np.where(known, from_bad[last], bad)
    is_odd = (exchanges - np.where(known, exchanges[last], 0)) % 2 == 1
    state: NDArray[np.bool_] = begun ^ is_odd
    return state


class GilbertElliott:
    """Loses packets in bursts.

    Parameters
    ----------
    failure
        P(good -> bad): the probability that a tick of the chain's clock leads from the good state to the bad.
    recovery
        P(bad -> good): the probability that a tick leads back.
    mean_loss
        Instead of failure and recovery, beside ``mean_burst``: the share of lost ticks.
    mean_burst
        The mean number of consecutive ticks that are lost.
    loss_good
        The loss probability in the good state.
    loss_bad
        The loss probability in the bad state.
    initial
        The state before the first tick; ``stationary`` draws it from the stationary law.
    clock
        What ticks: every ``step`` (whatever the traffic), every ``slot`` of the link, or every ``packet``.
        Links that share a stream share one chain, which only a clock of steps can drive.
    loss_from
        ``new_state``: the chain moves, then the loss is drawn from the state it moved to. ``old_state``: the
        loss is drawn first, as netem does; its first tick shows the initial state itself.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        failure: Probability | None = None,
        recovery: Probability | None = None,
        mean_loss: Probability | None = None,
        mean_burst: Annotated[float, Ge(1.0)] | None = None,
        loss_good: Probability = 0.0,
        loss_bad: Probability = 1.0,
        initial: Initial = "good",
        clock: Clock = "step",
        loss_from: LossFrom = "new_state",
    ) -> None:
        if failure is not None and recovery is not None and mean_loss is None and mean_burst is None:
            law = GilbertElliottLaw(failure, recovery, loss_good, loss_bad, initial, loss_from)
        elif mean_loss is not None and mean_burst is not None and failure is None and recovery is None:
            if (loss_good, loss_bad) != (0.0, 1.0):
                raise ValueError("mean_loss and mean_burst describe a chain with loss_good 0 and loss_bad 1")
            law = law_of_bursts(mean_loss, mean_burst, initial, loss_from)
        else:
            raise ValueError("give 'failure' and 'recovery', or 'mean_loss' and 'mean_burst'")
        if clock != "step" and placement.shares_streams:
            raise ValueError(f"a shared chain needs 'clock: step': a {clock} belongs to one link")
        self._placement = placement
        self._clock = clock
        self._chains = placement.by_link(lambda generator: GilbertElliottChain(law, generator))

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _LANES[self._clock](self._placement, link, self._chains[link])


class _ChainLane(Lane):
    """A link of a chain."""

    def __init__(self, placement: Placement, link: str, chain: GilbertElliottChain) -> None:
        super().__init__(placement, link)
        self._lost = chain.at
        self._next = chain.next

    def _lose(self, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        for packet in packets:
            ledger.lost(self.link, self.label, packet)
        return ()


class _StepLane(_ChainLane):
    """A link of a chain that steps drive."""

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        return self._lose(packets, ledger) if self._lost(slot.step) else packets

    def quiet_until(self, step: int) -> int:
        return self._next(step)


class _SlotLane(_ChainLane):
    """A link whose chain moves with each of its slots, an empty one too."""

    _tick = -1

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        self._tick += 1
        return self._lose(packets, ledger) if self._lost(self._tick) else packets


class _PacketLane(_ChainLane):
    """A link whose chain moves with each of its packets."""

    _tick = -1

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        arrived = []
        for packet in packets:
            self._tick += 1
            if self._lost(self._tick):
                ledger.lost(self.link, self.label, packet)
            else:
                arrived.append(packet)
        return packets if len(arrived) == len(packets) else arrived


_LANES: dict[Clock, type[_ChainLane]] = {"step": _StepLane, "slot": _SlotLane, "packet": _PacketLane}
