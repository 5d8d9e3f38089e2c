"""Packets: what the mathematics and the channel handle, and how they are laid out in messages."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from bus.messages import Inbox, Transmission

Vector = NDArray[np.float64]

UNSEALED = -1
"""The seal of a packet whose sender does not seal its packets."""


class Packet(msgspec.Struct, frozen=True):
    """One packet: who sent it in which step, its number in its stream, and its payload ``values`` (m,).

    ``kind`` is the stream's name and with it the meaning of ``values``. ``check`` is its seal (see
    `bus.integrity`). A struct, because it costs an eighth of a frozen dataclass, and there are hundreds in a
    step.
    """

    source: str
    sent_step: int
    sequence: int
    kind: str
    values: Vector
    check: int = UNSEALED


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
    sequences, checks = message.sequence, message.check
    if len(sequences) != len(message.offset) or (checks and len(checks) != len(sequences)):
        raise ValueError(
            f"{len(sequences)} sequence numbers for {len(message.offset)} offsets and {len(checks)} seals"
        )
    if not sequences:
        return []
    payloads = _payloads(message.values, message.offset)
    if len(sequences) == 1 and not checks:
        return [Packet(source, message.step, sequences[0], kind, payloads[0])]
    seals = checks or [UNSEALED] * len(sequences)
    return [
        Packet(source, message.step, sequence, kind, values, seal)
        for sequence, values, seal in zip(sequences, payloads, seals, strict=True)
    ]


def packets_of_inbox(message: Inbox) -> list[Packet]:
    """Return the packets of an inbox in order; raises ValueError when its lists do not fit one another."""
    columns = (message.source, message.sent_step, message.sequence, message.kind)
    size = len(message.offset)
    lengths = {size, len(message.check) or size, *(len(column) for column in columns)}
    if len(lengths) > 1:
        raise ValueError(f"the lists of an inbox have different lengths: {sorted(lengths)}")
    if not size:
        return []
    payloads = _payloads(message.values, message.offset)
    if message.check:
        return list(map(Packet, *columns, payloads, message.check))
    return list(map(Packet, *columns, payloads))


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
    source: list[str] = []
    sent_step: list[int] = []
    sequence: list[int] = []
    kind: list[str] = []
    offset: list[int] = []
    values: list[float] = []
    check: list[int] = []
    is_sealed = False
    for packet in packets:
        source.append(packet.source)
        sent_step.append(packet.sent_step)
        sequence.append(packet.sequence)
        kind.append(packet.kind)
        offset.append(len(values))
        values += packet.values.tolist()
        check.append(packet.check)
        is_sealed = is_sealed or packet.check != UNSEALED
    return Inbox(
        step=step,
        t=t,
        round=round_,
        source=source,
        sent_step=sent_step,
        sequence=sequence,
        kind=kind,
        offset=offset,
        values=values,
        check=check if is_sealed else [],
    )
