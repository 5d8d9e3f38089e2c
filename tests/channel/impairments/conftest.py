"""One link, driven by hand: what a stage does to one packet a slot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from bus.packets import Packet
from bus.random_streams import random_stream
from channel.contract import Event, Lane, Ledger, Placement, Slot

LINK = "s1->e1"


def packet(number: int, values: Sequence[float] = (1.0, 2.0)) -> Packet:
    return Packet("s1", number, number, "measurement", np.array(values))


@dataclass(frozen=True)
class Arrived:
    """What arrived in each slot, and what was noted."""

    slots: list[list[Packet]]
    events: list[Event]

    @property
    def sequences(self) -> list[list[int]]:
        return [[packet.sequence for packet in slot] for slot in self.slots]

    def events_of(self, action: str) -> list[Event]:
        return [event for event in self.events if event.action == action]


class Driven:
    """A stage on one link of its own stream, or on several of a shared one."""

    def __init__(
        self, kind: type[Any], seed: int = 1, streams: Mapping[str, str] | None = None, **given: Any
    ):
        self.streams = {LINK: LINK} if streams is None else streams
        generators = {name: random_stream(seed, 0, name, "stage") for name in self.streams.values()}
        self.stage = kind(Placement("stage", self.streams, generators), **given)

    def lane(self, link: str = LINK) -> Lane:
        lane: Lane = self.stage.lane(link)
        return lane

    def run(
        self, steps: int, per_slot: int = 1, act: Callable[[int], bool] = lambda step: True, link: str = LINK
    ) -> Arrived:
        """Send so many packets in each of the slots, and check the account in every one."""
        lane, ledger = self.lane(link), Ledger()
        slots, sent = [], 0
        for step in range(steps):
            packets = [packet(step * per_slot + number) for number in range(per_slot)]
            sent += per_slot
            call = lane.act if act(step) else lane.rest
            slots.append(list(call(Slot(step, 0, step), packets, ledger)))
            made = sum(event.action in ("injected", "duplicated") for event in ledger.events)
            lost = sum(event.action == "lost" for event in ledger.events)
            assert sent + made == lost + sum(map(len, slots)) + lane.held
        return Arrived(slots, ledger.events)


@pytest.fixture
def driven() -> type[Driven]:
    return Driven
