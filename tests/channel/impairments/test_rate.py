from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus.packets import Packet
from channel.contract import Ledger, Placement, Slot
from channel.impairments.rate import Rate


def test_a_link_that_carries_enough_keeps_nothing(driven: Any) -> None:
    arrived = driven(Rate, rate=2.0).run(50, per_slot=2)
    assert all(len(slot) == 2 for slot in arrived.slots)
    assert not arrived.events


@pytest.mark.parametrize(("rate", "steps", "carried"), [(0.5, 101, 51), (0.1, 101, 11), (1.5, 101, 152)])
def test_a_busy_link_carries_exactly_its_rate(driven: Any, rate: float, steps: int, carried: int) -> None:
    """The full bucket at once, then exactly ``rate`` a step, with a short queue or a long one."""
    for limit in (0, 3, 500):
        arrived = driven(Rate, rate=rate, limit=limit).run(steps, per_slot=2)
        assert sum(map(len, arrived.slots)) == carried


def test_packets_leave_in_the_order_in_which_they_came_and_their_wait_is_noted(driven: Any) -> None:
    arrived = driven(Rate, rate=0.5).run(5)
    assert arrived.sequences == [[0], [], [1], [], [2]]
    assert [(event.sequence, event.magnitude) for event in arrived.events] == [(1, 1.0), (2, 2.0)]


def test_a_full_queue_loses_the_newest(driven: Any) -> None:
    arrived = driven(Rate, rate=1.0, limit=2).run(2, per_slot=5)
    assert arrived.sequences == [[0], [1]]
    assert [event.sequence for event in arrived.events_of("lost")] == [3, 4, 6, 7, 8, 9]


def test_the_queue_empties_at_once_when_the_limit_ends(driven: Any) -> None:
    arrived = driven(Rate, rate=0.25, limit=10).run(6, act=lambda step: step < 4)
    assert arrived.sequences == [[0], [], [], [], [1, 2, 3, 4], [5]]


@given(
    st.lists(st.integers(0, 6), min_size=1, max_size=40),
    st.sampled_from([0.2, 0.5, 1.0, 1.7, 4.0]),
    st.integers(0, 5),
)
@settings(deadline=None, max_examples=60)
def test_the_queue_is_never_longer_than_its_bound(traffic: list[int], rate: float, limit: int) -> None:
    lane = Rate(Placement("rate", {"l": "l"}, {}), rate=rate, limit=limit).lane("l")
    ledger, sent, arrived = Ledger(), 0, 0
    for step, count in enumerate(traffic):
        packets = [Packet("s1", step, sent + number, "measurement", np.zeros(1)) for number in range(count)]
        sent += count
        arrived += len(lane.act(Slot(step, 0, step), packets, ledger))
        lost = sum(event.action == "lost" for event in ledger.events)
        assert lane.held <= limit
        assert sent == arrived + lost + lane.held
        assert arrived <= 1.0 + (step + 1) * rate


def test_links_cannot_share_a_queue() -> None:
    with pytest.raises(ValueError, match="a queue of its own"):
        Rate(Placement("rate", {"a": "m", "b": "m"}, {}), rate=1.0)
