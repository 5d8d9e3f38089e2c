"""Censored detection delays against lifelines, a library of survival analysis, and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from orchestrator.evidence.survival import kaplan_meier


def delays(rng: np.random.Generator, windows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return geometric delays, watched for 3 to 15 steps."""
    true, watched = rng.geometric(0.12, windows) - 1, rng.integers(3, 16, windows)
    return np.minimum(true, watched), true <= watched


def test_the_survival_function_is_that_of_lifelines() -> None:
    lifelines = pytest.importorskip("lifelines")
    delay, found = delays(np.random.default_rng(1), 60)
    fitted = lifelines.KaplanMeierFitter().fit(delay, found)
    own = kaplan_meier(delay, found)
    times = np.arange(own.horizon + 1)
    assert own.survival == pytest.approx(fitted.survival_function_at_times(times).to_numpy(), abs=1e-12)
    assert own.median.value == fitted.median_survival_time_
    mean = lifelines.utils.restricted_mean_survival_time(fitted, t=own.horizon + 1)
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
    rng, runs = np.random.default_rng(3), 200
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


def test_no_window_gives_no_delay() -> None:
    assert np.isnan(kaplan_meier(np.zeros(0, int), np.zeros(0, bool)).median.value)
