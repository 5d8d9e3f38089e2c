from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from channel.attacks.converging_bias import ConvergingBias


def test_gamma_has_the_norms_of_the_paper(placed, played):
    """Sadeghzadeh-Nokhodberiz 2022: with gamma_bar = 0.5 on four outputs."""
    attack = played(ConvergingBias(placed(first=7), target=0.5, probability=1.0))
    norms = [float(np.linalg.norm(attack.says(7 + k, 0.0, 0.0, 0.0, 0.0))) for k in range(5)]
    assert norms == pytest.approx([0.0, 0.1, 0.19, 0.271, 0.3439], abs=1e-12)


def test_in_the_first_step_nothing_is_attacked_since_gamma_is_zero(placed, played, packet):
    attack = played(ConvergingBias(placed(), target=3.0, probability=1.0))
    genuine = packet(0, 1.0)
    assert attack.slot(0, genuine) == [genuine]
    assert attack.actions == []


def test_gamma_moves_on_whether_the_attack_occurs_or_not(placed, played):
    attack = played(ConvergingBias(placed(), target=1.0, pole=0.5, probability=0.5))
    said = [attack.says(k, 0.0)[0] for k in range(40)]
    assert {0.0} < set(said)
    assert all(value in (0.0, pytest.approx(1.0 - 0.5**k)) for k, value in enumerate(said))


def test_it_occurs_with_its_probability(placed, played):
    """Binomial over independent steps; false-alarm rate 1e-6."""
    steps = 5000
    attack = played(ConvergingBias(placed(seed=3), target=1.0, probability=0.3))
    hits = sum(attack.says(k, 0.0) != [0.0] for k in range(1, steps + 1))
    low, high = binom.interval(1 - 1e-6, steps, 0.3)
    assert low <= hits <= high
