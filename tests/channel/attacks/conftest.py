"""Attacks by hand: a placement on links, and a link that is played slot by slot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from bus.packets import Packet
from bus.random_streams import random_stream
from channel.contract import Ledger, Placement, Slot

LINK = "s1->e1"


def placed(
    links: Sequence[str] = (LINK,), *, seed: int = 1, first: int = 0, shared: bool = False, **more: Any
) -> Placement:
    streams = {link: "medium" if shared else link for link in links}
    generators = {name: random_stream(seed, 0, name, "attack") for name in streams.values()}
    return Placement("attack", streams, generators, first, 10**6, **more)


def packet(step: int, *values: float, source: str = "s1") -> Packet:
    return Packet(source, step, step, "measurement", np.array(values, dtype=float))


@dataclass
class Played:
    """A link that is played in the order of its slots."""

    stage: Any
    link: str = LINK
    first: int = 0
    ledger: Ledger = field(default_factory=Ledger)

    def __post_init__(self) -> None:
        self.lane = self.stage.lane(self.link)

    def slot(self, step: int, *packets: Packet) -> list[Packet]:
        """Return what becomes of the packets of a step; before ``first`` the attack rests."""
        act = self.lane.act if step >= self.first else self.lane.rest
        return list(act(Slot(step, 0, step), list(packets), self.ledger))

    def says(self, step: int, *values: float) -> list[float]:
        """Return what one packet says after the attack."""
        (false,) = self.slot(step, packet(step, *values))
        return false.values.tolist()

    @property
    def actions(self) -> list[tuple[int, str]]:
        return [(event.sequence, event.action) for event in self.ledger.events]


@pytest.fixture(name="placed", scope="session")
def placed_fixture():
    return placed


@pytest.fixture(name="packet", scope="session")
def packet_fixture():
    return packet


@pytest.fixture(name="played", scope="session")
def played_fixture():
    return Played
