"""A rate limit: a link that carries so many packets a step, behind a queue that is bounded."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from fractions import Fraction
from typing import Annotated, ClassVar

from annotated_types import Ge, Interval

from bus.packets import Packet
from channel.contract import Lane, Ledger, Placement, Slot

_FINEST = 1_000_000  # rates are fractions with denominators up to this


class Rate:
    """Carries ``rate`` packets a step; the others wait their turn, and are lost where the queue is full.

    A token bucket that gains ``rate`` tokens a step and is full with less than ``rate + 1``: no step carries
    more than ``rate`` packets, rounded up, and a busy link exactly ``rate`` in the long run. What leaves the
    queue is noted as delayed by the steps that it waited. Outside its steps of action the queue empties at
    once.

    Parameters
    ----------
    rate
        Packets a step; it may be a fraction, as 0.5 for one packet every other step.
    limit
        The number of packets that may wait.
    """

    open_loop: ClassVar[bool] = False

    def __init__(
        self,
        placement: Placement,
        *,
        rate: Annotated[float, Interval(ge=1e-6, le=1e9)],
        limit: Annotated[int, Ge(0)] = 1000,
    ) -> None:
        if placement.shares_streams:
            raise ValueError("each link has a queue of its own; leave out 'scope' and 'stream'")
        self._placement = placement
        self._rate = Fraction(rate).limit_denominator(_FINEST)
        self._limit = limit

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _RateLane(self._placement, link, self._rate, self._limit)


class _RateLane(Lane):
    """Counts tokens in parts of a packet, so that sums are exact."""

    def __init__(self, placement: Placement, link: str, rate: Fraction, limit: int) -> None:
        super().__init__(placement, link)
        self._gain, self._packet = rate.numerator, rate.denominator
        self._most = self._gain + self._packet - 1
        self._tokens = self._most
        self._limit = limit
        self._step = 0
        self._queue: deque[tuple[int, Packet]] = deque()

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if slot.step != self._step:
            self._tokens = min(self._most, self._tokens + (slot.step - self._step) * self._gain)
            self._step = slot.step
        if not self._queue and len(packets) * self._packet <= self._tokens:
            self._tokens -= len(packets) * self._packet
            return packets
        return self._pass(slot, packets, ledger)

    def _pass(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Serve those who wait, then the new ones, each as far as tokens and queue go."""
        queue = self._queue
        queue.extend((slot.step, packet) for packet in packets)
        served = min(len(queue), self._tokens // self._packet)
        self._tokens -= served * self._packet
        passed = self._leave(served, slot.step, ledger)
        excess = [queue.pop() for _ in range(len(queue) - self._limit)]
        for _, packet in reversed(excess):
            ledger.lost(self.link, self.label, packet)
        self.held = len(queue)
        return passed

    def _leave(self, count: int, step: int, ledger: Ledger) -> list[Packet]:
        """Take packets from the head of the queue; note for how long they waited."""
        passed = []
        for _ in range(count):
            since, packet = self._queue.popleft()
            if step > since:
                ledger.delayed(self.link, self.label, packet, step - since)
            passed.append(packet)
        return passed

    def rest(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if not self._queue:
            return packets
        passed = self._leave(len(self._queue), slot.step, ledger)
        self.held = 0
        return [*passed, *packets]
