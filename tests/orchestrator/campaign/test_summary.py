from __future__ import annotations

import math

import numpy as np
import pytest

from orchestrator.campaign.summary import median_interval


def test_the_interval_of_a_median_is_between_known_order_statistics() -> None:
    # Conover, Practical Nonparametric Statistics: for n = 10 and 95 % the 2nd and the 9th of the values
    figure = median_interval(np.arange(1.0, 11.0)[::-1])
    assert (figure.median, figure.low, figure.high, figure.samples) == (5.5, 2.0, 9.0, 10)


def test_too_few_trials_have_no_interval() -> None:
    figure = median_interval(np.arange(5.0))
    assert (figure.low, figure.high) == (None, None)
    assert median_interval(np.arange(6.0)).low == 0.0


def test_the_interval_covers_the_median_as_often_as_it_says() -> None:
    # 2000 campaigns of 25 skewed values, covered with probability 0.957: 5.2 sigma, 1e-7 of false alarm
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(2000):
        figure = median_interval(rng.exponential(size=25))
        assert figure.low is not None
        assert figure.high is not None
        hits += figure.low <= math.log(2.0) <= figure.high
    assert hits / 2000 > 0.957 - 5.2 * math.sqrt(0.957 * 0.043 / 2000)
    assert hits / 2000 < 0.985


def test_a_figure_without_bound_stays_so() -> None:
    figure = median_interval(np.array([1.0, math.inf, math.inf]))
    assert figure.median == math.inf
    assert figure.facts()["median"] == "unbounded"
    assert median_interval(np.array([1.0, 2.0, math.inf])).median == pytest.approx(2.0)
