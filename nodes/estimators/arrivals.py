"""Which of the packets that arrived a filter can use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bus.packets import Packet


def measurements(step: int, packets: Sequence[Packet], sizes: Mapping[str, int]) -> Sequence[Packet]:
    """Return the packets that measure the state of ``step``, each of its sensor's size.

    A packet sent in an earlier step measured an earlier state: none of the methods here can use it as it is.
    Copies of one packet count once. Packets of one sensor that differ all count: which of them is genuine is
    for the method to judge.

    Parameters
    ----------
    step
        The current step.
    packets
        What arrived.
    sizes
        The number of values that each sensor measures.
    """
    size_of = sizes.get
    fitting = [p for p in packets if p.sent_step == step and p.values.size == size_of(p.source)]
    if len({packet.source for packet in fitting}) == len(fitting):
        return fitting
    return list({(p.source, p.sequence, p.values.tobytes()): p for p in fitting}.values())
