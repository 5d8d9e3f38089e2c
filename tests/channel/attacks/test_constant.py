from __future__ import annotations

import pytest

from channel.attacks.constant import Constant


def test_the_value_stands_in_place_of_the_named_components(placed, played):
    assert played(Constant(placed(), value=0.0)).says(0, 1.0, 2.0) == [0.0, 0.0]
    assert played(Constant(placed(), value=[8.0, 9.0], components=[2, 0])).says(0, 1.0, 2.0, 3.0) == [
        9.0,
        2.0,
        8.0,
    ]


def test_a_packet_that_says_the_value_already_is_not_attacked(placed, played, packet):
    attack = played(Constant(placed(), value=2.0))
    packets = [packet(0, 2.0)]
    assert attack.slot(0, *packets) == packets
    assert attack.actions == []


def test_a_value_that_does_not_fit_is_refused(placed, played):
    with pytest.raises(ValueError, match="s1->e1 does not fit a payload of 1 values"):
        played(Constant(placed(), value=[1.0, 2.0])).says(0, 1.0)
