from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest

from channel.attacks.scaling import Scaling


def test_a_fixed_share_mixes_payload_and_level(placed, played):
    attack = played(Scaling(placed(), low=0.25, high=0.25, value=[8.0, 0.0]))
    assert attack.says(0, 4.0, 4.0) == [5.0, 3.0]


def test_shares_are_uniform_within_their_bounds_and_independent_over_components(placed, played):
    """Kolmogorov-Smirnov on each of two components; false-alarm rate 2e-6, and 1e-6 for the correlation."""
    attack = played(Scaling(placed(seed=2), low=[0.1, -1.0], high=[1.5, 1.0], value=0.0))
    xi = 1.0 - np.array([attack.says(k, 1.0, 1.0) for k in range(4000)])
    for column, (low, high) in zip(xi.T, ((0.1, 1.5), (-1.0, 1.0)), strict=True):
        assert low - 1e-12 <= column.min() <= column.max() <= high + 1e-12
        assert kstest((column - low) / (high - low), "uniform").pvalue > 1e-6
    assert abs(np.corrcoef(xi.T)[0, 1]) < 4.9 / np.sqrt(len(xi))


@pytest.mark.parametrize("bounds", [{"low": 1.0, "high": 0.5}, {"low": [0.0, 1.0], "high": [1.0, 0.0]}])
def test_bounds_the_wrong_way_round_are_refused(placed, bounds):
    with pytest.raises(ValueError, match="exchange them"):
        Scaling(placed(), **bounds)
