"""The median over trials and its distribution-free interval."""

from __future__ import annotations

import math

import numpy as np

from orchestrator.evidence.intervals import median_of_trials


def test_the_interval_of_a_median_is_between_known_order_statistics() -> None:
    # Conover, Practical Nonparametric Statistics: for n = 10 and 95 % the 2nd and the 9th of the values
    found = median_of_trials(np.arange(1.0, 11.0)[::-1])
    assert (found.value, found.low, found.high) == (5.5, 2.0, 9.0)
    assert median_of_trials(np.arange(1.0, 11.0), 0.6).low > 2.0


def test_too_few_trials_have_no_interval() -> None:
    found = median_of_trials(np.arange(5.0))
    assert np.isnan([found.low, found.high]).all()
    assert median_of_trials(np.arange(6.0)).low == 0.0


def test_the_interval_covers_the_median_as_often_as_it_says() -> None:
    # 2000 campaigns of 25 skewed values, covered with probability 0.957: 5.2 sigma, 1e-7 of false alarm
    rng = np.random.default_rng(3)
    hits = sum(median_of_trials(rng.exponential(size=25)).holds(math.log(2.0)) for _ in range(2000))
    assert hits / 2000 > 0.957 - 5.2 * math.sqrt(0.957 * 0.043 / 2000)
    assert hits / 2000 < 0.985


def test_a_median_without_bound_stays_so() -> None:
    assert median_of_trials(np.array([1.0, math.inf, math.inf])).value == math.inf
    assert median_of_trials(np.array([1.0, 2.0, math.inf])).value == 2.0
