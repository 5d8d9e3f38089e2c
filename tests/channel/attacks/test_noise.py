from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from channel.attacks.noise import Noise

COVARIANCE = [[4.0, 1.2], [1.2, 1.0]]


def test_the_noise_has_the_covariance_that_was_asked_for(placed, played):
    """Mahalanobis norms sum to chi-square over independent slots; false-alarm rate 2e-6."""
    count = 4000
    attack = played(Noise(placed(seed=4), covariance=COVARIANCE))
    drawn = np.array([attack.says(k, 0.0, 0.0) for k in range(count)])
    low, high = chi2.interval(1 - 1e-6, count * 2)
    assert low <= np.einsum("ki,ij,kj->", drawn, np.linalg.inv(COVARIANCE), drawn) <= high
    assert count * drawn.mean(axis=0) @ np.linalg.inv(COVARIANCE) @ drawn.mean(axis=0) < chi2.isf(1e-6, 2)


def test_a_std_belongs_to_its_component(placed, played):
    attack = played(Noise(placed(), std=[0.0, 2.0], components=[2, 0]))
    said = attack.says(0, 1.0, 5.0, 7.0)
    assert said[1:] == [5.0, 7.0]
    assert said[0] != 1.0


@pytest.mark.parametrize(
    ("parameters", "cure"),
    [
        ({}, "exactly one of"),
        ({"std": 1.0, "covariance": [[1.0]]}, "exactly one of"),
        ({"std": -1.0}, "negative"),
        ({"covariance": [[1.0, 2.0], [2.0, 1.0]]}, "positive definite"),
        ({"covariance": [[1.0, 0.5], [0.0, 1.0]]}, "symmetric"),
        ({"covariance": [[1.0], [0.0, 1.0]]}, "square"),
    ],
)
def test_what_is_no_covariance_is_refused(placed, parameters, cure):
    with pytest.raises(ValueError, match=cure):
        Noise(placed(), **parameters)
