"""Packets: what the mathematics and the channel handle, and how they are laid out in messages."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np
from numpy.typing import NDArray

from bus.messages import Inbox, Transmission

Vector = NDArray[np.float64]

ORACLE = "oracle"
"""The kind of a packet that holds what an adversary adds to a sensor's measurement (m,), whenever it does.

``source`` is the sensor. Only the channel makes such packets, for estimators that are granted the privilege.
"""

UNSEALED = -1
"""The seal of a packet whose sender does not seal its packets."""
_ONE_PACKET = [0]


class Packet(msgspec.Struct, frozen=True):
    """One packet: who sent it in which step, its number in its stream, and its payload ``values`` (m,).

    ``kind`` is the stream's name and with it the meaning of ``values``, which receivers only read. ``check``
    is its seal (see `bus.integrity`). A struct, because it costs an eighth of a frozen dataclass, and there
    are hundreds in a step.
    """

    source: str
    sent_step: int
    sequence: int
    kind: str
    values: Vector
    check: int = UNSEALED


class Sending(msgspec.Struct, frozen=True):
    """The slot of one sender, as the packets themselves: what a `Transmission` tells."""

    step: int
    t: float
    round: int
    packets: Sequence[Packet]

    def message(self) -> Transmission:
        """Return the message that tells it; raises ValueError for several packets, which no node sends."""
        if not self.packets:
            return transmission(self.step, self.t, self.round, 0, None)
        (packet,) = self.packets
        values = packet.values.tolist()
        return transmission(self.step, self.t, self.round, packet.sequence, values, packet.check)


class Delivery(msgspec.Struct, frozen=True):
    """What reaches one receiver, as the packets themselves: what an `Inbox` tells.

    One that is ``untouched`` holds nothing but packets as their senders sent them, in the slot in which they
    did: its receiver has nothing to refuse.
    """

    step: int
    t: float
    round: int
    packets: list[Packet]
    untouched: bool

    @property
    def source(self) -> list[str]:
        """The source of each packet."""
        return [packet.source for packet in self.packets]

    @property
    def sequence(self) -> list[int]:
        """The number of each packet in its stream."""
        return [packet.sequence for packet in self.packets]

    def message(self) -> Inbox:
        """Return the message that tells it."""
        return inbox(self.step, self.t, self.round, self.packets)


def _payloads(values: list[float], offset: list[int]) -> list[Vector]:
    """Return the payload of each packet; raises ValueError when the offsets do not partition the values."""
    whole = np.array(values)
    whole.flags.writeable = False
    if offset == _ONE_PACKET:
        return [whole]
    ends = [*offset, len(values)]
    if ends[0] != 0 or sorted(ends) != ends:
        raise ValueError(f"offsets {offset} do not partition {len(values)} values")
    return [whole[begin:end] for begin, end in pairwise(ends)]


def packets_of_transmission(message: Transmission | Sending, source: str, kind: str) -> Sequence[Packet]:
    """Return the packets of a sender's slot, their values for reading only.

    Raises ValueError when its lists do not fit one another.
    """
    if isinstance(message, Sending):
        return message.packets
    sequences, checks = message.sequence, message.check
    if len(sequences) != len(message.offset) or (checks and len(checks) != len(sequences)):
        raise ValueError(
            f"{len(sequences)} sequence numbers for {len(message.offset)} offsets and {len(checks)} seals"
        )
    if not sequences:
        return []
    if message.offset == _ONE_PACKET:
        whole = np.array(message.values)
        whole.flags.writeable = False
        return [Packet(source, message.step, sequences[0], kind, whole, *checks)]
    payloads = _payloads(message.values, message.offset)
    seals = checks or [UNSEALED] * len(sequences)
    return [
        Packet(source, message.step, sequence, kind, values, seal)
        for sequence, values, seal in zip(sequences, payloads, seals, strict=True)
    ]


def packets_of_inbox(message: Inbox | Delivery) -> list[Packet]:
    """Return the packets of an inbox in order, their values for reading only.

    Raises ValueError when its lists do not fit one another.
    """
    if isinstance(message, Delivery):
        return message.packets
    source, sent_step, sequence, kind = message.source, message.sent_step, message.sequence, message.kind
    offset, check = message.offset, message.check
    size = len(offset)
    if not len(source) == len(sent_step) == len(sequence) == len(kind) == size == (len(check) or size):
        lengths = {len(column) for column in (source, sent_step, sequence, kind, offset)} | {len(check)}
        raise ValueError(f"the lists of an inbox have different lengths: {sorted(lengths)}")
    if not size:
        return []
    payloads = _payloads(message.values, offset)
    if check:
        return list(map(Packet, source, sent_step, sequence, kind, payloads, check))
    return list(map(Packet, source, sent_step, sequence, kind, payloads))


def holds(message: Inbox | Delivery, kind: str) -> bool:
    """Return whether an inbox holds a packet of a kind."""
    if isinstance(message, Delivery):
        return any(packet.kind == kind for packet in message.packets)
    return kind in message.kind


def transmission(
    step: int, t: float, round_: int, sequence: int, values: list[float] | None, check: int = UNSEALED
) -> Transmission:
    """Return the slot that carries one payload, or a quiet slot when ``values`` is None."""
    if values is None:
        return Transmission(step=step, t=t, round=round_, sequence=[], offset=[], values=[], check=[])
    return Transmission(
        step=step,
        t=t,
        round=round_,
        sequence=[sequence],
        offset=[0],
        values=values,
        check=[] if check == UNSEALED else [check],
    )


def inbox(step: int, t: float, round_: int, packets: Sequence[Packet]) -> Inbox:
    """Return the inbox that carries the packets, in the order given."""
    offset: list[int] = []
    values: list[float] = []
    for packet in packets:
        offset.append(len(values))
        values += packet.values.tolist()
    check = [packet.check for packet in packets]
    return Inbox(
        step=step,
        t=t,
        round=round_,
        source=[packet.source for packet in packets],
        sent_step=[packet.sent_step for packet in packets],
        sequence=[packet.sequence for packet in packets],
        kind=[packet.kind for packet in packets],
        offset=offset,
        values=values,
        check=check if check.count(UNSEALED) < len(check) else [],
    )
