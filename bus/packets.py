"""Packets: what the mathematics and the channel handle, and how they are laid out in messages."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from bus.messages import Inbox, Transmission

Vector = NDArray[np.float64]


class Packet(msgspec.Struct, frozen=True):
    """One packet: who sent it in which step, its number in its stream, and its payload ``values`` (m,).

    ``kind`` is the stream's name and with it the meaning of ``values``. A struct, because it costs an eighth
    of a frozen dataclass, and there are hundreds in a step.
    """

    source: str
    sent_step: int
    sequence: int
    kind: str
    values: Vector


def _payloads(values: list[float], offset: list[int]) -> list[Vector]:
    """Return the payload of each packet; raises ValueError when the offsets do not partition the values."""
    whole = np.array(values)
    payloads = []
    begin = offset[0] if offset else -1
    fits = begin == 0
    for end in (*offset[1:], len(values)):
        fits = fits and begin <= end
        payloads.append(whole[begin:end])
        begin = end
    if not fits:
        raise ValueError(f"offsets {offset} do not partition {len(values)} values")
    return payloads


def packets_of_transmission(message: Transmission, source: str, kind: str) -> list[Packet]:
    """Return the packets of a sender's slot; raises ValueError when its lists do not fit one another."""
    sequences = message.sequence
    if len(sequences) != len(message.offset):
        raise ValueError(f"{len(sequences)} sequence numbers for {len(message.offset)} offsets")
    if not sequences:
        return []
    payloads = _payloads(message.values, message.offset)
    return [
        Packet(source, message.step, sequence, kind, values)
        for sequence, values in zip(sequences, payloads, strict=True)
    ]


def packets_of_inbox(message: Inbox) -> list[Packet]:
    """Return the packets of an inbox in order; raises ValueError when its lists do not fit one another."""
    columns = (message.source, message.sent_step, message.sequence, message.kind)
    lengths = {len(message.offset), *(len(column) for column in columns)}
    if len(lengths) > 1:
        raise ValueError(f"the lists of an inbox have different lengths: {sorted(lengths)}")
    if not message.source:
        return []
    return list(map(Packet, *columns, _payloads(message.values, message.offset)))


def transmission(step: int, t: float, round_: int, sequence: int, values: list[float] | None) -> Transmission:
    """Return the slot that carries one payload, or a quiet slot when ``values`` is None."""
    if values is None:
        return Transmission(step=step, t=t, round=round_, sequence=[], offset=[], values=[])
    return Transmission(step=step, t=t, round=round_, sequence=[sequence], offset=[0], values=values)


def inbox(step: int, t: float, round_: int, packets: Sequence[Packet]) -> Inbox:
    """Return the inbox that carries the packets, in the order given."""
    offset: list[int] = []
    values: list[float] = []
    for packet in packets:
        offset.append(len(values))
        values += packet.values.tolist()
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
    )
