"""Seals on packets: a check sum that catches accidents, or a keyed one that catches forgers as well.

A sender that the plan names in ``integrity`` seals each of its packets; receivers refuse what does not fit.
``crc`` is a CRC-32, which anybody can compute: an adversary who changes a packet seals it anew. ``mac`` is a
BLAKE2 hash under a key of the sender's: who does not hold the key cannot seal. Both cover the packet's
header and the bytes of its values.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Callable, Collection, Sequence

from bus.packets import UNSEALED, Packet
from bus.plan import Plan

CRC = "crc"

Seal = Callable[[Packet], int]
"""Computes the seal that a packet must carry."""

_MAC_BYTES = 6  # JSON holds whole numbers up to 2^53


def _header(packet: Packet) -> bytes:
    return f"{packet.source}/{packet.kind}/{packet.sent_step}/{packet.sequence}".encode()


def check_sum(packet: Packet) -> int:
    """Return the CRC-32 of a packet's header and values."""
    return zlib.crc32(packet.values.tobytes(), zlib.crc32(_header(packet)))


def key_of(plan: Plan, node: str) -> bytes:
    """Return the secret key of a node in this run."""
    return hashlib.blake2b(f"{plan.seed}\x00{plan.trial}\x00{node}\x00key".encode()).digest()


def _keyed(key: bytes) -> Seal:
    def seal(packet: Packet) -> int:
        text = _header(packet) + b"\x00" + packet.values.tobytes()
        return int.from_bytes(hashlib.blake2b(text, key=key, digest_size=_MAC_BYTES).digest(), "little")

    return seal


def seal_of(plan: Plan, node: str) -> Seal | None:
    """Return how a node seals its packets, None when it does not."""
    integrity = plan.integrity.get(node)
    if integrity is None:
        return None
    return check_sum if integrity == CRC else _keyed(key_of(plan, node))


class Gate:
    """Lets in the packets that a receiver may believe to come from one of its sources.

    Refused are packets of a source that the receiver does not listen to, and packets of one that seals its
    packets whose seal does not fit.
    """

    def __init__(self, plan: Plan, sources: Collection[str]) -> None:
        self._sources = frozenset(sources)
        self._seals = {name: seal for name in sources if (seal := seal_of(plan, name)) is not None}

    def admits(self, packet: Packet) -> bool:
        """Tell whether a packet may be let in."""
        seal = self._seals.get(packet.source)
        if seal is None:
            return packet.source in self._sources
        return packet.check == seal(packet)

    def is_open_to(self, sources: Sequence[str]) -> bool:
        """Tell whether all packets that claim these sources are let in, whatever they say."""
        return not self._seals and self._sources.issuperset(sources)

    def admit(self, packets: Sequence[Packet]) -> Sequence[Packet]:
        """Return the packets that may be let in, in their order."""
        if self.is_open_to([packet.source for packet in packets]):
            return packets
        return [packet for packet in packets if self.admits(packet)]


class Forger:
    """Seals packets as an adversary can: whoever knows no keys cannot seal for a sender that has one.

    A false packet of such a sender keeps the seal of the packet that it was made from, which does not fit.
    """

    def __init__(self, plan: Plan, holds_keys: bool) -> None:
        self._plan = plan
        self._holds_keys = holds_keys
        self._seals: dict[str, Seal | None] = {}

    def seal(self, packet: Packet) -> int:
        """Return the seal for a false packet."""
        source = packet.source
        if source not in self._seals:
            can = self._holds_keys or self._plan.integrity.get(source) == CRC
            self._seals[source] = seal_of(self._plan, source) if can else None
        seal = self._seals[source]
        if seal is not None:
            return seal(packet)
        if source not in self._plan.integrity:
            return UNSEALED
        return packet.check if packet.check != UNSEALED else check_sum(packet)
