"""What a stage of the channel is: it stands on links and decides the fate of their packets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np

from bus.packets import Packet


@dataclass(slots=True)
class Ledger:
    """What stages did to the packets of one slot, in the order in which they did it."""

    stage: list[str] = field(default_factory=list)
    sequence: list[int] = field(default_factory=list)
    action: list[str] = field(default_factory=list)
    magnitude: list[float] = field(default_factory=list)

    def _note(self, stage: str, packet: Packet, action: str, magnitude: float) -> None:
        self.stage.append(stage)
        self.sequence.append(packet.sequence)
        self.action.append(action)
        self.magnitude.append(magnitude)

    def lost(self, stage: str, packet: Packet) -> None:
        """Note that a stage dropped a packet."""
        self._note(stage, packet, "lost", 0.0)

    def attacked(self, stage: str, packet: Packet, magnitude: float) -> None:
        """Note that a stage changed a packet's values by ``magnitude`` (Euclidean norm)."""
        self._note(stage, packet, "attacked", magnitude)

    def attacked_sequences(self) -> set[int]:
        """Return the numbers of the packets that at least one stage attacked."""
        return {
            sequence
            for sequence, action in zip(self.sequence, self.action, strict=True)
            if action == "attacked"
        }

    def extend(self, other: Ledger) -> None:
        """Append another slot's notes."""
        self.stage += other.stage
        self.sequence += other.sequence
        self.action += other.action
        self.magnitude += other.magnitude


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

    It is called once for every slot of each of its links inside its window of steps, in the order of the steps on each
    link, but in any order over links: what it draws for a shared stream must depend on the step alone.
    """

    open_loop: ClassVar[bool]
    """True when fates depend on seed, stream and step or slot alone, never on what the traffic holds."""

    def apply(self, link: str, step: int, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Return what becomes of the packets of one slot, and note every change in the ledger."""
        ...
