from __future__ import annotations

from channel.attacks.stale import Stale


def test_packets_say_what_was_said_some_slots_ago_under_new_headers(placed, played, packet):
    attack = played(Stale(placed(first=4), age=3), first=4)
    for step in range(4):
        assert attack.says(step, float(step)) == [float(step)]
    (false,) = attack.slot(4, packet(4, 4.0))
    assert (false.sent_step, false.sequence, false.values.tolist()) == (4, 4, [1.0])
    assert [attack.says(step, float(step))[0] for step in (5, 6, 7, 8)] == [2.0, 3.0, 4.0, 5.0]


def test_where_the_old_slot_was_empty_the_newest_before_it_serves(placed, played):
    attack = played(Stale(placed(first=3), age=2), first=3)
    attack.says(0, 0.0)
    attack.slot(1)
    attack.says(2, 2.0)
    assert attack.says(3, 3.0) == [0.0]


def test_packets_pass_while_nothing_is_old_enough(placed, played):
    attack = played(Stale(placed(), age=2))
    assert [attack.says(step, float(step))[0] for step in range(4)] == [0.0, 1.0, 0.0, 1.0]
    assert attack.actions == [(2, "attacked"), (3, "attacked")]
