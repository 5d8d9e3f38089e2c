"""What a stage of the channel is: it stands on links and decides the fate of their packets."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final, NamedTuple, Protocol, TypeVar

import numpy as np
from msgspec.structs import replace

from bus import keys
from bus.integrity import Forger
from bus.packets import Packet, Vector

LOST: Final = "lost"
"""Dropped; magnitude 0."""
ATTACKED: Final = "attacked"
"""Values or header changed by an adversary; magnitude is the Euclidean norm of the change of the values."""
INJECTED: Final = "injected"
"""A packet that nobody sent; magnitude is the Euclidean norm of its values."""
DUPLICATED: Final = "duplicated"
"""A further copy of a packet; magnitude 0."""
ALTERED: Final = "altered"
"""Values changed by the network itself; magnitude as for attacked."""
DELAYED: Final = "delayed"
"""Kept for a later slot; magnitude is for how long: steps, or slots where a kind counts slots."""

NEVER: Final = sys.maxsize
"""A step after the end of every run."""

T = TypeVar("T")


class Slot(NamedTuple):
    """One slot of a link: its step, its round in the step, and its ``number`` among all of its link."""

    step: int
    round: int
    number: int


_GREATEST = sys.float_info.max


def norm(values: Vector) -> float:
    """Return the Euclidean norm, or the greatest number when that is less: a log holds no infinity."""
    return min(math.hypot(*values.tolist()), _GREATEST)


def distance(a: Vector, b: Vector) -> float:
    """Return the Euclidean distance, or the greatest number when that is less.

    Of payloads of different sizes it is the norm of the first.
    """
    return min(math.dist(a.tolist(), b.tolist()), _GREATEST) if a.size == b.size else norm(a)


class Event(NamedTuple):
    """One thing that a stage did to a packet; what ``magnitude`` means is told beside each action."""

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
        """Note that a stage falsified a packet."""
        self.events.append(Event(link, stage, packet.sequence, ATTACKED, magnitude))

    def injected(self, link: str, stage: str, packet: Packet) -> None:
        """Note that a stage added a packet that nobody sent."""
        magnitude = norm(packet.values)  # the score finds the packet again by it
        self.events.append(Event(link, stage, packet.sequence, INJECTED, magnitude))

    def duplicated(self, link: str, stage: str, packet: Packet) -> None:
        """Note that a stage added a copy of a packet."""
        self.events.append(Event(link, stage, packet.sequence, DUPLICATED, 0.0))

    def altered(self, link: str, stage: str, packet: Packet, magnitude: float) -> None:
        """Note that the network itself changed a packet's values."""
        self.events.append(Event(link, stage, packet.sequence, ALTERED, magnitude))

    def delayed(self, link: str, stage: str, packet: Packet, slots: int) -> None:
        """Note that a stage keeps a packet for a number of slots (or steps)."""
        self.events.append(Event(link, stage, packet.sequence, DELAYED, float(slots)))


@dataclass(frozen=True)
class Placement:
    """Where a stage stands, what it draws from, and what it is granted to know.

    Parameters
    ----------
    label
        Names the stage in the log.
    streams
        The name of the random stream of each of its links; links that name the same one share one chain.
    generators
        One random generator a stream; draw blocks from it, or make addressed ones of it (`channel.draws`).
    first, last
        The window of steps in which it acts, both inclusive.
    forger
        Seals false packets, as far as the adversary can; None seals nothing.
    knowledge
        What the topology grants it to know: matrices as nested lists, by name.
    carries
        The stream of packets that each of its links carries (`bus.keys`); measurements if not told.
    """

    label: str
    streams: Mapping[str, str]
    generators: Mapping[str, np.random.Generator]
    first: int = 0
    last: int = 0
    forger: Forger | None = None
    knowledge: Mapping[str, Any] = field(default_factory=dict)
    carries: Mapping[str, str] = field(default_factory=dict)

    def kind_on(self, link: str) -> str:
        """Return the kind of the packets that a link carries."""
        return self.carries.get(link, keys.MEASUREMENT)

    def by_link(self, make: Callable[[np.random.Generator], T]) -> dict[str, T]:
        """Return what ``make`` makes of each stream's generator, by link; links of one stream share it."""
        made = {stream: make(generator) for stream, generator in self.generators.items()}
        return {link: made[stream] for link, stream in self.streams.items()}

    @property
    def shares_streams(self) -> bool:
        """Whether some of its links share a stream."""
        return len(set(self.streams.values())) < len(self.streams)

    def forged(self, packet: Packet, values: Vector, **header: Any) -> Packet:
        """Return a false packet made from another, sealed as the adversary can.

        Raises FloatingPointError for values that are not finite: no message carries them.
        """
        if not np.isfinite(values).all():
            raise FloatingPointError(
                f"{self.label} made a value that is not finite, {values.tolist()}; give it smaller parameters"
            )
        false = replace(packet, values=values, **header)
        if self.forger is None:
            return false
        check = self.forger.seal(false)
        return false if check == false.check else replace(false, check=check)


class Lane:
    """What one stage does on one link; it may keep state, and keep packets for later slots.

    It is called once for every slot of its link, in their order: `act` in steps of action, `rest` in the
    others; slots that it is quiet in are left out. Whoever keeps packets counts them in ``held`` and lets
    them go in `rest` as well.
    """

    held: int = 0

    def __init__(self, placement: Placement, link: str) -> None:
        self.placement = placement
        self.label = placement.label
        self.link = link

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Return what becomes of the packets of one slot, and note every change in the ledger."""
        return packets

    def rest(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Return the packets of a slot outside the steps of action."""
        return packets

    def reveal(self, slot: Slot, values: Vector) -> Vector | None:
        """Return what it adds to a payload (m,) in a slot if it attacks it, whether it does so or not.

        An estimator that is granted it is told so. None, for all kinds by default, when that cannot be told.
        """
        return None

    def quiet_until(self, step: int) -> int:
        """Return a step before which, from the given one on, `act` and `rest` would hand on what they get.

        They are not called before it while nothing is held: a kind that knows its fates ahead saves most of
        its calls. By default it is the given step itself, and they are called for every slot.
        """
        return step


class Stage(Protocol):
    """One declared stage over all its links. A kind is constructed as ``Kind(placement, **parameters)``.

    A kind may declare more: ``default_integrity`` (``"crc"``: its senders seal their packets unless told
    otherwise), ``acts_as_sender`` (True: it stands for a part of the sender, and seals in its name),
    ``reveals`` (True: its lanes tell what they add).

    Its lanes are called in the order of the slots on each link, but in any order over links: what it draws
    for a shared stream must depend on the step alone.
    """

    open_loop: ClassVar[bool]
    """True when fates depend on seed, stream and step or slot alone, never on what the traffic holds."""

    def lane(self, link: str) -> Lane:
        """Return what it does on one of its links; called once a link."""
        ...
