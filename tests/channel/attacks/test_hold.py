from __future__ import annotations

from channel.attacks.hold import Hold


def test_the_last_value_before_the_attack_is_held_under_new_headers(placed, played, packet):
    attack = played(Hold(placed(first=3)), first=3)
    assert attack.says(1, 1.0, 10.0) == [1.0, 10.0]
    assert attack.slot(2) == []
    (false,) = attack.slot(3, packet(3, 3.0, 30.0))
    assert (false.sent_step, false.sequence, false.values.tolist()) == (3, 3, [1.0, 10.0])
    assert attack.says(4, 4.0, 40.0) == [1.0, 10.0]
    assert attack.actions == [(3, "attacked"), (4, "attacked")]


def test_without_a_packet_before_the_first_one_of_the_attack_is_held(placed, played):
    attack = played(Hold(placed()))
    assert [attack.says(step, float(step))[0] for step in (0, 1, 2)] == [0.0, 0.0, 0.0]
    assert attack.actions == [(1, "attacked"), (2, "attacked")]


def test_only_the_named_components_are_held(placed, played):
    attack = played(Hold(placed(first=1), components=[1]), first=1)
    attack.says(0, 1.0, 10.0)
    assert attack.says(1, 2.0, 20.0) == [2.0, 10.0]
