from __future__ import annotations

import numpy as np
import pytest

from channel.attacks.injection import Injection
from channel.attacks.laws import Box, Copied, CountLaw, Near, ValueLaw
from channel.contract import Ledger, Slot


def test_fakes_stand_beside_the_genuine_packet_under_its_header(placed, played, packet):
    attack = played(Injection(placed(), values=ValueLaw(near=Near(0.5)), count=3))
    genuine = packet(4, 10.0)
    first, *fakes = attack.slot(4, genuine)
    assert first is genuine
    assert [(f.source, f.sent_step, f.sequence, f.kind) for f in fakes] == 3 * [("s1", 4, 4, "measurement")]
    assert all(0.0 < abs(f.values[0] - 10.0) <= 0.5 for f in fakes)
    assert attack.actions == 3 * [(4, "injected")]


def test_fakes_come_where_nothing_was_sent_under_the_header_of_a_genuine_one(placed, played):
    placement = placed(["e1->e2"], carries={"e1->e2": "exchange"})
    attack = played(Injection(placement, values=ValueLaw(box=Box([0.0], 1.0))), link="e1->e2")
    (fake,) = attack.slot(6)
    assert (fake.source, fake.sent_step, fake.sequence, fake.kind) == ("e1", 6, 6, "exchange")


def test_nothing_is_injected_before_the_size_of_a_payload_is_known(placed, played, packet):
    attack = played(Injection(placed(first=2), values=ValueLaw(box=Box(0.0, 1.0))), first=2)
    assert attack.slot(0) == attack.slot(2) == []
    assert len(attack.slot(3, packet(3, 1.0, 2.0))) == 2
    assert attack.slot(4)[0].values.size == 2


def test_a_copy_is_never_of_the_slot_itself(placed, played, packet):
    attack = played(Injection(placed(), values=ValueLaw(copied=Copied()), count=2))
    assert len(attack.slot(0, packet(0, 0.0))) == 1
    assert [fake.values[0] for fake in attack.slot(1, packet(1, 1.0))[1:]] == [0.0, 0.0]


def test_a_slot_without_fakes_passes_as_it_is(placed, played, packet):
    lane = Injection(placed(), values=ValueLaw(near=Near(1.0)), count=0).lane("s1->e1")
    packets = [packet(0, 1.0)]
    assert lane.act(Slot(0, 0, 0), packets, Ledger()) is packets


def test_a_law_that_does_not_fit_names_the_link(placed, played, packet):
    attack = played(Injection(placed(), values=ValueLaw(box=Box([0.0, 0.0], 1.0))))
    with pytest.raises(ValueError, match="attack on s1->e1: a law of 2 values"):
        attack.slot(0, packet(0, 1.0))


def test_counts_and_values_of_a_slot_depend_on_the_slot_alone(placed, played, packet):
    def stage():
        return Injection(placed(seed=9), values=ValueLaw(box=Box([-1.0], 1.0)), count=CountLaw(poisson=3.0))

    whole, late = played(stage()), played(stage())
    slots = [[p.values.tolist() for p in whole.slot(step)] for step in range(20)]
    assert [p.values.tolist() for p in late.slot(13, packet(13, 5.0))[1:]] == slots[13]
    assert len({len(slot) for slot in slots}) > 1
    assert np.unique([value for slot in slots for value in slot]).size == sum(map(len, slots))
