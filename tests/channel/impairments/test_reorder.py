from __future__ import annotations

from typing import Any

from scipy.stats import binom

from channel.impairments.reorder import Reorder


def test_a_held_packet_is_passed_by_those_of_the_slots_between(driven: Any) -> None:
    arrived = driven(Reorder, probability=1.0, hold=2).run(5)
    assert arrived.sequences == [[], [], [0], [1], [2]]
    assert [event.magnitude for event in arrived.events_of("delayed")] == [2.0] * 5


def test_what_is_held_leaves_in_its_slot_even_outside_the_steps_of_action(driven: Any) -> None:
    arrived = driven(Reorder, probability=1.0, hold=3).run(6, act=lambda step: step < 2)
    assert arrived.sequences == [[], [], [2], [0, 3], [1, 4], [5]]


def test_the_share_of_held_packets_is_binomial(driven: Any) -> None:
    """Independent over steps; false-alarm rate 1e-6."""
    arrived = driven(Reorder, probability=0.25, hold=2).run(4000)
    low, high = binom.interval(1 - 1e-6, 4000, 0.25)
    assert low <= len(arrived.events_of("delayed")) <= high
    order = [sequence for slot in arrived.sequences for sequence in slot]
    assert order != sorted(order)
