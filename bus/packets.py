"""Packets: what the mathematics and the channel handle, and how they are laid out in messages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bus.messages import Inbox, Transmission

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet: who sent it in which step, its number in its stream, and its payload ``values`` (m,).

    ``kind`` is the stream's name and with it the meaning of ``values``.
    """

    source: str
    sent_step: int
    sequence: int
    kind: str
    values: Vector


def _bounds(offset: Sequence[int], total: int) -> Iterable[tuple[int, int]]:
    """Yield the (begin, end) of each packet; raises ValueError when the offsets do not partition the values."""
    bounds = [*offset, total]
    if bounds[0] != 0 or any(a > b for a, b in zip(bounds, bounds[1:], strict=False)):
        raise ValueError(f"offsets {offset} do not partition {total} values")
    return zip(bounds, bounds[1:], strict=False)


def packets_of_transmission(message: Transmission, source: str, kind: str) -> list[Packet]:
    """Return the packets of a sender's slot; raises ValueError when its lists do not fit one another."""
    bounds = _bounds(message.offset, len(message.values))
    return [
        Packet(source, message.step, sequence, kind, np.array(message.values[begin:end]))
        for sequence, (begin, end) in zip(message.sequence, bounds, strict=True)
    ]


def packets_of_inbox(message: Inbox) -> list[Packet]:
    """Return the packets of an inbox in its order; raises ValueError when its lists do not fit one another."""
    bounds = _bounds(message.offset, len(message.values))
    columns = zip(
        message.source, message.sent_step, message.sequence, message.kind, bounds, strict=True
    )
    return [
        Packet(source, sent_step, sequence, kind, np.array(message.values[begin:end]))
        for source, sent_step, sequence, kind, (begin, end) in columns
    ]


def transmission(step: int, t: float, round_: int, sequence: int, values: Vector | None) -> Transmission:
    """Return the slot that carries one payload, or a quiet slot when ``values`` is None."""
    if values is None:
        return Transmission(step=step, t=t, round=round_, sequence=[], offset=[], values=[])
    return Transmission(
        step=step, t=t, round=round_, sequence=[sequence], offset=[0], values=values.tolist()
    )


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
