"""Censored detection delays against lifelines, a library of survival analysis, and by hand."""

from __future__ import annotations

import lifelines
import numpy as np
import pytest
from lifelines.utils import restricted_mean_survival_time
from scipy import stats

from orchestrator.evidence.survival import kaplan_meier


def delays(rng: np.random.Generator, windows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return geometric delays, watched for 3 to 15 steps."""
    true, watched = rng.geometric(0.12, windows) - 1, rng.integers(3, 16, windows)
    return np.minimum(true, watched), true <= watched


def test_the_survival_function_is_that_of_lifelines() -> None:
    delay, found = delays(np.random.default_rng(1), 60)
    fitted = lifelines.KaplanMeierFitter().fit(delay, found)
    own = kaplan_meier(delay, found)
    times = np.arange(own.horizon + 1)
    assert own.survival == pytest.approx(fitted.survival_function_at_times(times).to_numpy(), abs=1e-12)
    assert own.median.value == fitted.median_survival_time_
    mean = restricted_mean_survival_time(fitted, t=own.horizon + 1)
    assert own.restricted_mean.value == pytest.approx(mean, abs=1e-12)


def test_the_survival_function_is_that_of_scipy() -> None:
    delay, found = delays(np.random.default_rng(2), 50)
    expected = stats.ecdf(stats.CensoredData.right_censored(delay, ~found)).sf
    own = kaplan_meier(delay, found)
    assert own.survival == pytest.approx(expected.evaluate(np.arange(own.horizon + 1)), abs=1e-12)


def test_a_missed_attack_is_neither_dropped_nor_taken_for_a_detection() -> None:
    """Delays 1, 3, and a miss watched for 2 steps: S(1) = 2/3, and only one is at risk at 3."""
    own = kaplan_meier(np.array([1, 2, 3]), np.array([True, False, True]))
    assert own.survival == pytest.approx([1.0, 2 / 3, 2 / 3, 0.0])
    assert own.restricted_mean.value == pytest.approx(1.0 + 2 / 3 + 2 / 3)  # dropped: 2, detected: 2
    assert (own.windows, own.found) == (3, 2)


def test_an_attack_that_half_the_trials_miss_has_no_median() -> None:
    own = kaplan_meier(np.full(10, 5), np.arange(10) < 4)
    assert own.median.value == np.inf
    assert own.survival[-1] == pytest.approx(0.6)


def test_the_restricted_mean_is_unbiased_under_censoring() -> None:
    """The interval holds the true mean of min(delay, 10) at its confidence; false-alarm rate below 1e-6."""
    rng, runs = np.random.default_rng(3), 120
    truth = np.sum((1 - 0.12) ** np.arange(1, 11))
    held = 0
    for _ in range(runs):
        delay, found = delays(rng, 60)
        held += kaplan_meier(delay, found, horizon=9, resamples=400).restricted_mean.holds(truth)
    assert stats.binom.ppf(5e-7, runs, 0.93) <= held <= stats.binom.ppf(1 - 5e-7, runs, 0.965)


def test_windows_of_one_trial_are_resampled_together() -> None:
    """Ten copies of a window in each trial tell no more than one: the interval is as wide."""
    delay, found = delays(np.random.default_rng(4), 30)
    one = kaplan_meier(delay, found).restricted_mean
    trial = np.repeat(np.arange(30), 10)
    many = kaplan_meier(np.repeat(delay, 10), np.repeat(found, 10), trial).restricted_mean
    assert (many.low, many.high) == pytest.approx((one.low, one.high))


def test_trials_that_are_all_alike_leave_room_for_others() -> None:
    """Twenty trials found at once: with 95 % confidence no more than 1 - 0.05^(1/19) of all differ."""
    own = kaplan_meier(np.zeros(20, int), np.ones(20, bool), horizon=4)
    unseen = 1.0 - 0.05 ** (1.0 / 19.0)
    assert own.survival == pytest.approx(np.zeros(5))
    assert own.low == pytest.approx(np.zeros(5))
    assert own.high == pytest.approx(np.full(5, unseen))
    mean = own.restricted_mean
    assert (mean.value, mean.low, mean.high) == pytest.approx((0.0, 0.0, 5.0 * unseen))


def test_a_median_is_known_to_the_step_where_most_trials_are_sure_to_be_alike() -> None:
    """Six alike bound the others below one half, which the order statistics of six values do; five do not."""
    six, five = (kaplan_meier(np.full(n, 2), np.ones(n, bool)).median for n in (6, 5))
    assert (six.value, six.low, six.high) == (2.0, 2.0, 2.0)
    assert (five.value, five.low, five.high) == (2.0, 0.0, np.inf)


def test_the_interval_of_a_median_inverts_the_band() -> None:
    delay, found = delays(np.random.default_rng(6), 60)
    own = kaplan_meier(delay, found)
    assert own.median.low == np.flatnonzero(own.low <= 0.5)[0] < own.median.value
    assert own.median.value < own.median.high == np.flatnonzero(own.high <= 0.5)[0]
    one = kaplan_meier(np.array([3, 4]), np.ones(2, bool), np.zeros(2, int)).median
    assert one.value == 3.0
    assert np.isnan([one.low, one.high]).all()


def test_a_time_that_few_trials_were_watched_for_is_known_by_few() -> None:
    """Nobody is found; two of ten trials were watched beyond step 1."""
    own = kaplan_meier(np.where(np.arange(10) < 2, 5, 1), np.zeros(10, bool))
    assert own.low[:2] == pytest.approx([0.05 ** (1.0 / 9.0)] * 2)
    assert own.low[2:] == pytest.approx([0.05] * 4)
    assert own.high == pytest.approx(np.ones(6))


def test_the_mean_of_delays_that_are_rarely_seen_to_differ_is_held_by_its_interval() -> None:
    """One of 50 attacks is found 5 steps late: two campaigns in three, of 20 trials, see none of these.

    Their bootstrap interval is [0, 0] and wrong. The false-alarm rate of this test is below 1e-6.
    """
    rng, runs, held = np.random.default_rng(7), 200, 0
    for _ in range(runs):
        delay = np.where(rng.random(20) < 0.02, 5, 0)
        own = kaplan_meier(delay, np.ones(20, bool), horizon=9, resamples=200).restricted_mean
        held += own.holds(0.1)
    assert held >= stats.binom.ppf(5e-7, runs, 0.95)


def test_no_window_gives_no_delay() -> None:
    assert np.isnan(kaplan_meier(np.zeros(0, int), np.zeros(0, bool)).median.value)
