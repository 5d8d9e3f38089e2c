"""Rates of rare events over trials: closed forms, and how often their intervals hold the truth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from orchestrator.evidence.bootstrap import bootstrap, pooled
from orchestrator.evidence.intervals import only
from orchestrator.evidence.rates import pooled_rate, unseen_share


def test_where_no_trial_has_an_event_the_rate_is_bounded_by_how_many_trials_there_are() -> None:
    """The upper end is that share of trials with an event of which 19 others show none in 5 % of cases."""
    found = only(pooled_rate(np.zeros((20, 1)), np.full((20, 1), 35.0)))
    assert (found.value, found.low) == (0.0, 0.0)
    assert (1.0 - found.high) ** 19 == pytest.approx(0.05)
    full = only(pooled_rate(np.full((20, 1), 35.0), np.full((20, 1), 35.0)))
    assert (full.value, full.low, full.high) == pytest.approx((1.0, 1.0 - found.high, 1.0))


def test_trials_that_all_have_the_same_rate_leave_room_on_both_sides() -> None:
    found = only(pooled_rate(np.ones((10, 1)), np.full((10, 1), 5.0)))
    unseen = 1.0 - 0.05 ** (1.0 / 9.0)
    assert found.value == pytest.approx(0.2)
    assert (found.low, found.high) == pytest.approx((0.2 * (1.0 - unseen), 0.2 * (1.0 - unseen) + unseen))


def test_a_lower_confidence_leaves_less_room_and_more_trials_leave_less() -> None:
    assert unseen_share(np.array([1, 2, 20, 200])) == pytest.approx([1.0, 0.95, 0.1459, 0.01494], rel=1e-3)
    assert unseen_share(np.array([20]), 0.5) < unseen_share(np.array([20]), 0.95)


def test_trials_without_a_chance_tell_nothing() -> None:
    chances = np.where(np.arange(20) < 5, 10.0, 0.0)[:, None]
    found = only(pooled_rate(np.zeros((20, 1)), chances))
    assert found.high == pytest.approx(1.0 - 0.05 ** (1.0 / 4.0))
    assert np.isnan(only(pooled_rate(np.zeros((20, 1)), np.zeros((20, 1)))).high)


def test_one_trial_has_no_interval() -> None:
    found = only(pooled_rate(np.zeros((1, 1)), np.ones((1, 1))))
    assert found.value == 0.0
    assert np.isnan([found.low, found.high]).all()


def test_trials_that_differ_have_the_interval_of_the_bootstrap() -> None:
    events = np.random.default_rng(1).binomial(35, 0.1, (20, 1)).astype(float)
    chances = np.full((20, 1), 35.0)
    assert only(pooled_rate(events, chances)) == only(bootstrap(pooled(events, chances), 20))


def _alone(rng: np.random.Generator) -> np.ndarray:
    return rng.binomial(35, 1e-3, 20)


def _nearly_all(rng: np.random.Generator) -> np.ndarray:
    return rng.binomial(35, 0.9995, 20)


def _locked_out(rng: np.random.Generator) -> np.ndarray:
    return np.where(rng.random(20) < 0.05, 14, 0)


@pytest.mark.parametrize(
    ("draw", "rate", "without"),
    [(_alone, 1e-3, 0.45), (_nearly_all, 0.9995, 0.3), (_locked_out, 0.02, 0.64)],
)
def test_the_interval_of_a_rare_event_holds_its_rate_whether_it_comes_alone_or_fills_a_trial(
    draw: Callable[[np.random.Generator], np.ndarray], rate: float, without: float
) -> None:
    """Of campaigns of 20 trials of 35 packets; ``without``: what the bootstrap alone holds, about.

    The false-alarm rate is below 1e-6 in each case.
    """
    rng, runs, held, alone = np.random.default_rng(2), 400, 0, 0
    chances = np.full((20, 1), 35.0)
    for _ in range(runs):
        events = draw(rng).astype(float)[:, None]
        found, plain = only(pooled_rate(events, chances)), only(bootstrap(pooled(events, chances), 20))
        held += found.low <= rate * (1 + 1e-12) and rate <= found.high * (1 + 1e-12)
        alone += plain.holds(rate)
    assert held >= stats.binom.ppf(5e-7, runs, 0.95)
    assert abs(alone / runs - without) < 5.2 * np.sqrt(without * (1 - without) / runs)
