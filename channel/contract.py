"""What a stage of the channel is: it stands on links and decides the fate of their packets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple, Protocol

import numpy as np

from bus.packets import Packet

LOST: Final = "lost"
ATTACKED: Final = "attacked"


class Event(NamedTuple):
    """One thing that a stage did to a packet; ``magnitude`` is the Euclidean norm of its values' change."""

    link: str
    stage: str
    sequence: int
    action: str
    magnitude: float


class Ledger:
    """What stages did in one round of a step. Links write in any order, the stages of a link in theirs."""

    __slots__ = ("events",)

    def __init__(self) -> None:
        self.events: list[Event] = []

    def lost(self, link: str, stage: str, packet: Packet) -> None:
        """Note that a stage dropped a packet."""
        self.events.append(Event(link, stage, packet.sequence, LOST, 0.0))

    def attacked(self, link: str, stage: str, packet: Packet, magnitude: float) -> None:
        """Note that a stage changed a packet's values."""
        self.events.append(Event(link, stage, packet.sequence, ATTACKED, magnitude))


@dataclass(frozen=True)
class Placement:
    """Where a stage stands and what it draws from.

    ``streams`` names the random stream of each of its links; links that name the same stream share one chain.
    ``generators`` holds one random generator a stream.
    """

    label: str
    streams: Mapping[str, str]
    generators: Mapping[str, np.random.Generator]


class Stage(Protocol):
    """One declared stage over all its links. A kind is constructed as ``Kind(placement, **parameters)``.

    It is called once for every slot of each of its links inside its window of steps, in the order of the
    steps on each link, but in any order over links: what it draws for a shared stream must depend on the step
    alone.
    """

    open_loop: ClassVar[bool]
    """True when fates depend on seed, stream and step or slot alone, never on what the traffic holds."""

    def apply(self, link: str, step: int, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Return what becomes of the packets of one slot, and note every change in the ledger."""
        ...
