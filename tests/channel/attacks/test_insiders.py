"""Nodes that lie themselves: babbling and Byzantine ones."""

from __future__ import annotations

import numpy as np
import pytest

from channel.attacks.babbling import Babbling
from channel.attacks.byzantine import Byzantine
from channel.attacks.laws import Box, ValueLaw

LINKS = ["e3->e1", "e3->e2"]


def test_a_babbling_node_sends_more_of_what_it_says(placed, played, packet):
    attack = played(Babbling(placed(LINKS), count=4, spread=0.1), link=LINKS[0])
    packets = attack.slot(5, packet(5, 1.0, 2.0, source="e3"))
    assert [(p.source, p.sent_step, p.sequence) for p in packets] == 5 * [("e3", 5, 5)]
    assert all(np.all(np.abs(p.values - [1.0, 2.0]) <= 0.1) for p in packets)
    assert attack.actions == 4 * [(5, "injected")]


def test_it_babbles_on_what_it_said_last_and_not_before_its_first_packet(placed, played, packet):
    attack = played(Babbling(placed(LINKS), count=2), link=LINKS[0])
    assert attack.slot(0) == []
    attack.slot(1, packet(1, 3.0, source="e3"))
    assert [(p.sent_step, p.values.tolist()) for p in attack.slot(2)] == [(2, [3.0]), (2, [3.0])]


def test_a_byzantine_node_tells_each_neighbour_something_else(placed, played, packet):
    stage = Byzantine(placed(LINKS), spread=[1.0, 2.0], components=[0, 2])
    told = []
    for link in LINKS:
        (false,) = played(stage, link=link).slot(4, packet(4, 10.0, 20.0, 30.0, source="e3"))
        assert (false.source, false.sent_step, false.sequence) == ("e3", 4, 4)
        assert false.values[1] == 20.0
        assert 0.0 < abs(false.values[0] - 10.0) <= 1.0
        assert 0.0 < abs(false.values[2] - 30.0) <= 2.0
        told.append(false.values.tolist())
    assert told[0] != told[1]


def test_a_byzantine_node_may_follow_a_law(placed, played, packet):
    stage = Byzantine(placed(LINKS), values=ValueLaw(box=Box(7.0, 7.0)))
    assert played(stage, link=LINKS[0]).says(0, 1.0, 2.0) == [7.0, 7.0]


def test_a_byzantine_node_cannot_share_its_draws(placed):
    with pytest.raises(ValueError, match="told the same"):
        Byzantine(placed(LINKS, shared=True), spread=1.0)


@pytest.mark.parametrize("parameters", [{}, {"spread": 1.0, "values": ValueLaw(box=Box(0.0, 1.0))}])
def test_what_it_says_is_stated_once(placed, parameters):
    with pytest.raises(ValueError, match="exactly one of 'spread' and 'values'"):
        Byzantine(placed(LINKS), **parameters)
