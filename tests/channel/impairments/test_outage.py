from __future__ import annotations

from typing import Any

import pytest

from channel.contract import NEVER
from channel.impairments.outage import Outage


def test_everything_is_lost_in_the_windows_and_nothing_outside(driven: Any) -> None:
    arrived = driven(Outage, windows=[[2, 3], [6, 6]]).run(8)
    assert [step for step, slot in enumerate(arrived.slots) if not slot] == [2, 3, 6]
    assert [event.sequence for event in arrived.events_of("lost")] == [2, 3, 6]


def test_it_knows_when_it_will_act_next(driven: Any) -> None:
    lane = driven(Outage, windows=[[6, 6], [2, 3]]).lane()
    assert [lane.quiet_until(step) for step in (0, 2, 3, 4, 6, 7)] == [2, 2, 3, 6, 6, NEVER]


def test_a_window_that_runs_backwards_is_refused(driven: Any) -> None:
    with pytest.raises(ValueError, match=r"write \[3, 5\]"):
        driven(Outage, windows=[[5, 3]])
