from __future__ import annotations

import pytest

from channel.attacks.replay import Replay


def captured(placed, played, packet, **parameters):
    attack = played(Replay(placed(first=5), capture=[1, 3], **parameters), first=5)
    for step in (0, 1, 3, 4):
        attack.says(step, float(step))
        if step == 1:
            attack.slot(2)
    return attack


def test_captured_slots_are_played_under_the_headers_of_now_and_loop(placed, played, packet):
    attack = captured(placed, played, packet)
    passed = [attack.slot(step, packet(step, float(step))) for step in range(5, 10)]
    assert [[(p.sent_step, p.sequence, p.values.tolist()) for p in slot] for slot in passed] == [
        [(5, 5, [1.0])],
        [],
        [(7, 7, [3.0])],
        [(8, 8, [1.0])],
        [],
    ]
    assert attack.actions == [(5, "attacked"), (6, "lost"), (7, "attacked"), (8, "attacked"), (9, "lost")]


def test_without_rewriting_packets_come_as_they_were_captured(placed, played, packet):
    attack = captured(placed, played, packet, rewrite=False)
    (old,) = attack.slot(5, packet(5, 5.0))
    assert (old.sent_step, old.sequence, old.values.tolist()) == (1, 1, [1.0])
    assert attack.ledger.events == [("s1->e1", "attack", 1, "attacked", 4.0)]


def test_what_is_played_into_a_quiet_slot_was_injected(placed, played, packet):
    attack = captured(placed, played, packet)
    (false,) = attack.slot(5)
    assert (false.source, false.sent_step, false.sequence, false.values.tolist()) == ("s1", 5, 5, [1.0])
    assert attack.actions == [(5, "injected")]


@pytest.mark.parametrize("capture", [[1], [3, 2], [-1, 2]])
def test_a_capture_that_is_no_window_is_refused(placed, capture):
    with pytest.raises(ValueError, match=r"must be \[first, last\]"):
        Replay(placed(first=9), capture=capture)


def test_a_capture_that_runs_into_the_attack_is_refused(placed):
    with pytest.raises(ValueError, match="give the attack later 'steps'"):
        Replay(placed(first=5), capture=[2, 5])
