from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import binom

from bus.packets import Packet
from channel.contract import Ledger, Slot
from channel.impairments.jammer import Jammer


def lost_steps(arrived: Any) -> list[int]:
    return [step for step, slot in enumerate(arrived.slots) if not slot]


def test_a_jammer_without_recharge_jams_as_many_steps_as_its_budget_pays(driven: Any) -> None:
    arrived = driven(Jammer, budget=5.0, cost=2.0).run(20)
    assert lost_steps(arrived) == [0, 1]


def test_in_the_long_run_it_jams_the_share_that_its_recharge_pays(driven: Any) -> None:
    """Exact: 10 at once, and then one step in four; the battery gained 89 quarters by step 89."""
    arrived = driven(Jammer, budget=10.0, cost=1.0, recharge=0.25).run(90)
    assert len(lost_steps(arrived)) == 10 + 89 // 4
    assert lost_steps(arrived)[:14] == [*range(13), 16]


def test_its_budget_lasts_until_its_first_step_of_action(driven: Any) -> None:
    arrived = driven(Jammer, budget=3.0).run(20, act=lambda step: step >= 10)
    assert lost_steps(arrived) == [10, 11, 12]


def test_one_jammer_decides_for_all_links_of_a_stream_but_not_which_slots_survive(driven: Any) -> None:
    streams = {"a->b": "m", "b->a": "m"}
    both = driven(Jammer, streams=streams, budget=9.0, probability=0.5)
    assert lost_steps(both.run(60, link="a->b")) == lost_steps(both.run(60, link="b->a"))
    half = driven(Jammer, streams=streams, budget=100.0, loss=0.5)
    assert lost_steps(half.run(60, link="a->b")) != lost_steps(half.run(60, link="b->a"))


def test_links_may_ask_in_any_order(driven: Any) -> None:
    streams = {"a->b": "m", "b->a": "m"}
    given = {"streams": streams, "budget": 4.0, "recharge": 0.3, "probability": 0.6}
    one, two = driven(Jammer, **given), driven(Jammer, **given)
    first = one.run(50, link="a->b"), one.run(50, link="b->a")
    lanes = [two.lane("b->a"), two.lane("a->b")]
    packets = [Packet("a", 0, 0, "measurement", np.zeros(1))]
    meanwhile = [[lane.act(Slot(step, 0, step), packets, Ledger()) for lane in lanes] for step in range(50)]
    assert [step for step, (_, a) in enumerate(meanwhile) if not a] == lost_steps(first[0])
    assert [step for step, (b, _) in enumerate(meanwhile) if not b] == lost_steps(first[1])


def test_a_rich_jammer_loses_with_its_two_probabilities(driven: Any) -> None:
    """Independent over steps, so binomial; false-alarm rate 1e-6."""
    lost = len(lost_steps(driven(Jammer, budget=1e9, probability=0.6, loss=0.5).run(5000)))
    low, high = binom.interval(1 - 1e-6, 5000, 0.3)
    assert low <= lost <= high


def test_a_budget_that_pays_for_nothing_is_refused(driven: Any) -> None:
    with pytest.raises(ValueError, match="raise 'budget'"):
        driven(Jammer, budget=1.0, cost=2.0)
