from __future__ import annotations

import numpy as np
from scipy.stats import binom

from channel.attacks.laws import Box, Copied, ValueLaw
from channel.attacks.substitution import Substitution


def test_a_fake_stands_in_place_of_the_genuine_packet_under_its_header(placed, played, packet):
    attack = played(Substitution(placed(), probability=1.0, values=ValueLaw(box=Box(5.0, 6.0))))
    (fake,) = attack.slot(3, packet(3, 0.0, 0.0))
    assert (fake.source, fake.sent_step, fake.sequence) == ("s1", 3, 3)
    assert np.all((fake.values >= 5.0) & (fake.values <= 6.0))
    assert attack.actions == [(3, "attacked")]
    assert attack.slot(4) == []


def test_slots_are_attacked_with_the_given_probability(placed, played):
    """Binomial over independent slots; false-alarm rate 1e-6."""
    attack = played(Substitution(placed(seed=8), probability=0.1, values=ValueLaw(box=Box(5.0, 6.0))))
    hits = sum(attack.says(k, 0.0) != [0.0] for k in range(3000))
    low, high = binom.interval(1 - 1e-6, 3000, 0.1)
    assert low <= hits <= high


def test_a_copy_comes_from_an_earlier_slot_even_one_before_the_attack(placed, played, packet):
    attack = played(
        Substitution(placed(first=1), probability=1.0, values=ValueLaw(copied=Copied(1))), first=1
    )
    attack.slot(0, packet(0, 7.0))
    assert [attack.says(1, 1.0), attack.says(2, 2.0)] == [[7.0], [1.0]]
