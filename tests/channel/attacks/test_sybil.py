from __future__ import annotations

import pytest

from channel.attacks.laws import Box, Near, ValueLaw
from channel.attacks.sybil import Sybil

LINK = "s4->e1"


def test_packets_come_in_the_name_of_another_node_under_a_header_of_its_own(placed, played, packet):
    attack = played(Sybil(placed([LINK]), identity="s7", values=ValueLaw(near=Near(1.0)), count=2), link=LINK)
    genuine, *false = attack.slot(3, packet(3, 5.0, source="s4"))
    assert genuine.source == "s4"
    assert [(p.source, p.sent_step, p.sequence) for p in false] == 2 * [("s7", 3, 3)]
    assert attack.ledger.events[0][:4] == (LINK, "attack", 3, "injected")


def test_a_node_needs_no_sybil_of_itself(placed):
    with pytest.raises(ValueError, match="use 'injection' there"):
        Sybil(placed([LINK]), identity="s4", values=ValueLaw(box=Box(0.0, 1.0)))
