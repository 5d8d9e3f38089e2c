"""Packets and loss bursts as the channel counted them."""

from __future__ import annotations

import msgspec
import pytest

from orchestrator.score.gather import ScoreError
from orchestrator.score.scoring import score


def test_packets_are_summed_by_link_and_in_all(make_plan, recorder):
    recorder.channel(0, {"s1->e1": (1, 0, 1, 1), "s2->e1": (2, 1, 0, 1)})
    recorder.channel(1, {"s1->e1": (1, 1, 0, 0), "s2->e1": (2, 0, 0, 2)})
    result = score(make_plan(2, {"e1": ["s1", "s2"]}), recorder.records, state_groups={})
    figures = [(t.sent, t.lost, t.attacked, t.delivered) for t in (link.traffic for link in result.links)]
    assert figures == [(2, 1, 1, 1), (4, 1, 0, 3)]
    total = result.traffic
    assert (total.sent, total.lost, total.attacked, total.delivered) == (6, 2, 1, 4)
    assert total.lost_share == pytest.approx(1 / 3)


def test_a_loss_burst_is_a_run_of_consecutive_packets_of_a_link(make_plan, recorder):
    for step in range(8):
        lost = [("s1->e1", "loss", step, "lost")] if step in (1, 2, 3, 6) else []
        lost += [("s2->e1", "loss", step, "lost")] if step in (4, 5) else []
        recorder.channel(
            step, {"s1->e1": (1, step in (1, 2, 3, 6), 0, 1), "s2->e1": (1, step in (4, 5), 0, 1)}, lost
        )
    result = score(make_plan(8, {"e1": ["s1", "s2"]}), recorder.records, state_groups={})
    assert [link.traffic.loss_bursts for link in result.links] == [2, 1]
    assert [link.traffic.mean_loss_burst for link in result.links] == [2.0, 2.0]
    assert result.traffic.loss_bursts == 3


def test_shares_of_nothing_are_undefined(make_plan):
    total = score(make_plan(1, {"e1": ["s1"]}), [], state_groups={}).traffic
    assert (total.sent, total.lost_share, total.mean_loss_burst) == (0, None, None)


def test_a_link_that_the_plan_does_not_have_is_refused(make_plan, recorder):
    recorder.channel(0, {"s9->e1": (1, 0, 0, 1)})
    with pytest.raises(ScoreError, match="link that the plan does not have"):
        score(make_plan(1, {"e1": ["s1"]}), recorder.records, state_groups={})


def test_injected_duplicated_and_refused_packets_are_summed_and_those_in_flight_taken_at_the_end(
    make_plan, recorder
):
    counts = [([2, 0], [0, 1], [1, 0], [0, 3]), ([], [], [], [0, 2]), ([1, 0], [], [1, 1], [0, 1])]
    for step, (injected, duplicated, refused, in_flight) in enumerate(counts):
        recorder.channel(step, {"s1->e1": (1, 0, 0, 1), "s2->e1": (1, 0, 0, 1)})
        topic, message = recorder.records[-1]
        more = {"injected": injected, "duplicated": duplicated, "refused": refused, "in_flight": in_flight}
        recorder.records[-1] = topic, msgspec.structs.replace(message, **more)
    recorder.records.reverse()
    result = score(make_plan(3, {"e1": ["s1", "s2"]}), recorder.records, state_groups={})
    by_link = [(t.injected, t.duplicated, t.refused, t.in_flight) for t in (x.traffic for x in result.links)]
    assert by_link == [(3, 0, 2, 0), (0, 1, 1, 1)]
    assert (result.traffic.injected, result.traffic.in_flight) == (3, 1)


def test_nothing_is_in_flight_when_the_last_account_says_nothing(make_plan, recorder):
    for step, in_flight in enumerate(([2], [])):
        recorder.channel(step, {"s1->e1": (1, 0, 0, 1)})
        topic, message = recorder.records[-1]
        recorder.records[-1] = topic, msgspec.structs.replace(message, in_flight=in_flight)
    assert score(make_plan(2, {"e1": ["s1"]}), recorder.records, state_groups={}).traffic.in_flight == 0
