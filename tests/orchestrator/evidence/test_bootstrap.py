"""Bootstrap intervals against scipy's, and how often they hold the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from orchestrator.evidence.bootstrap import bootstrap, pooled, root_mean_square
from orchestrator.evidence.intervals import mean_of_trials, share


def errors(rng: np.random.Generator, trials: int, steps: int) -> np.ndarray:
    """Return norms of two-dimensional errors that are correlated over steps: RMS sqrt(2)."""
    noise = rng.normal(size=(trials, steps, 2))
    for k in range(1, steps):
        noise[:, k] = 0.8 * noise[:, k - 1] + 0.6 * noise[:, k]
    return np.sqrt(np.sum(noise**2, axis=2))


def test_the_interval_is_scipys_bca_interval_but_for_the_draws() -> None:
    norms = errors(np.random.default_rng(1), 40, 3)
    band = bootstrap(root_mean_square(norms), 40, resamples=20000)
    for k in range(3):
        own = stats.bootstrap(
            (norms[:, k],), lambda x, axis: np.sqrt(np.mean(x**2, axis=axis)), n_resamples=20000, rng=2
        ).confidence_interval
        width = own.high - own.low
        assert band.low[k] == pytest.approx(own.low, abs=0.05 * width)
        assert band.high[k] == pytest.approx(own.high, abs=0.05 * width)


def test_the_band_of_an_rmse_holds_the_truth_at_its_confidence() -> None:
    """BCa of 40 trials covers a little less than 95 %; the false-alarm rate is below 1e-6."""
    rng, runs, held = np.random.default_rng(3), 400, 0
    for _ in range(runs):
        band = bootstrap(root_mean_square(errors(rng, 40, 1)), 40, resamples=600)
        held += int(band.low[0] <= np.sqrt(2.0) <= band.high[0])
    assert stats.binom.ppf(5e-7, runs, 0.92) <= held <= stats.binom.ppf(1 - 5e-7, runs, 0.96)


def test_trials_are_resampled_and_not_their_steps() -> None:
    """Trials that repeat one value at all their steps have a band as wide as one step's."""
    value = np.abs(np.random.default_rng(4).normal(size=(30, 1)))
    one = bootstrap(root_mean_square(value), 30)
    total = np.full((30, 1), 50.0)
    many = bootstrap(pooled(50.0 * value**2, total, np.sqrt), 30)
    assert many.low == pytest.approx(one.low)
    assert many.high == pytest.approx(one.high)


def test_the_same_trials_give_the_same_band() -> None:
    norms = errors(np.random.default_rng(5), 12, 6)
    once, again = (bootstrap(root_mean_square(norms), 12) for _ in range(2))
    assert np.array_equal(once.low, again.low)
    assert np.array_equal(once.high, again.high)


def test_what_is_unknown_in_a_trial_leaves_the_others() -> None:
    norms = errors(np.random.default_rng(6), 10, 2)
    norms[3, 1] = np.nan
    band = bootstrap(root_mean_square(norms), 10)
    assert band.value[1] == pytest.approx(np.sqrt(np.nanmean(norms[:, 1] ** 2)))
    assert band.low[1] < band.value[1] < band.high[1]
    norms[:, 1] = np.nan
    assert np.isnan(bootstrap(root_mean_square(norms), 10).low[1])


def test_one_trial_has_no_interval() -> None:
    band = bootstrap(root_mean_square(np.array([[3.0, 4.0]])), 1)
    assert band.value.tolist() == [3.0, 4.0]
    assert np.isnan(band.low).all()


def test_shares_have_the_intervals_of_wilson_and_of_clopper_and_pearson() -> None:
    z = stats.norm.ppf(0.975)
    wilson, exact = share(3, 20), share(3, 20, method="exact")
    centre, reach = (3 + z**2 / 2) / (20 + z**2), z / (20 + z**2) * np.sqrt(3 * 17 / 20 + z**2 / 4)
    assert (wilson.low, wilson.high) == pytest.approx((centre - reach, centre + reach))
    assert (exact.low, exact.high) == pytest.approx(
        (stats.beta.ppf(0.025, 3, 18), stats.beta.ppf(0.975, 4, 17))
    )
    assert share(0, 20).low == 0.0
    assert np.isnan(share(0, 0).value)


def test_a_mean_over_trials_has_students_interval() -> None:
    values = np.random.default_rng(7).normal(size=9)
    expected = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    found = mean_of_trials(values)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))
