from __future__ import annotations

from scipy.stats import binom

from channel.attacks.flip import Flip


def test_signs_or_bits_are_flipped(placed, played):
    assert played(Flip(placed())).says(0, 1.0, -2.0) == [-1.0, 2.0]
    assert played(Flip(placed(), components=[1])).says(0, 1.0, -2.0) == [1.0, 2.0]
    assert played(Flip(placed(), binary=True)).says(0, 1.0, 0.0) == [0.0, 1.0]


def test_a_slot_is_attacked_with_the_given_probability(placed, played):
    """Binomial over independent slots; false-alarm rate 1e-6."""
    attack = played(Flip(placed(seed=6), probability=0.2))
    hits = sum(attack.says(k, 1.0) == [-1.0] for k in range(5000))
    low, high = binom.interval(1 - 1e-6, 5000, 0.2)
    assert low <= hits <= high
