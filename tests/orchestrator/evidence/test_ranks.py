"""Rank statistics against their definitions, and how often they call equals different."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from orchestrator.evidence.ranks import holm, pair, paired_difference, unpaired_difference


def test_the_shift_is_the_median_of_the_walsh_averages() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 9))
    d = a - b
    averages = [(d[i] + d[j]) / 2 for i in range(9) for j in range(i, 9)]
    assert paired_difference(a, b).shift.value == pytest.approx(np.median(averages), rel=1e-14)


@pytest.mark.parametrize("n", [6, 8, 12])
def test_the_interval_holds_exactly_the_shifts_that_the_test_does_not_reject(n: int) -> None:
    rng = np.random.default_rng(n)
    d = rng.normal(0.7, 1.0, n)
    low, high = (getattr(paired_difference(d, np.zeros(n)).shift, end) for end in ("low", "high"))
    for shift in np.linspace(-3.0, 4.0, 400):
        rejected = stats.wilcoxon(d - shift).pvalue <= 0.05
        assert rejected == (shift < low or shift > high), shift


def test_the_interval_covers_the_true_shift_in_95_percent_of_samples() -> None:
    """The false-alarm rate of this test is below 1e-6; discreteness adds less than 0.5 % to the coverage."""
    rng, runs = np.random.default_rng(2), 400
    shifts = [paired_difference(rng.laplace(0.3, 1.0, 25), np.zeros(25)).shift for _ in range(runs)]
    covered = sum(shift.holds(0.3) for shift in shifts)
    assert stats.binom.ppf(5e-7, runs, 0.95) <= covered <= stats.binom.ppf(1 - 5e-7, runs, 0.955)


def test_infinite_errors_are_ranked_and_not_dropped() -> None:
    finite = np.arange(1.0, 13.0)
    a, b = finite.copy(), finite + 0.5
    a[:3] = np.inf  # A diverges three times, and is a little better otherwise
    found = paired_difference(a, b)
    large = paired_difference(np.where(np.isinf(a), 1e9, a), b)
    assert found.sizes == (12, 12)
    assert (found.p_value, found.effect) == (large.p_value, large.effect)
    assert found.shift.high == np.inf
    assert found.shift.low == pytest.approx(-0.5)


def test_two_that_both_diverged_are_a_tie() -> None:
    both = np.full(8, np.inf)
    assert paired_difference(both, both).identical
    assert paired_difference(both, both).shift.value == 0.0


def test_effect_sizes_are_those_of_their_definitions() -> None:
    rng = np.random.default_rng(3)
    a, b = rng.integers(0, 6, (2, 15)).astype(float)
    d = (a - b)[a != b]
    ranks = stats.rankdata(np.abs(d))
    favourable, unfavourable = ranks[d > 0].sum(), ranks[d < 0].sum()
    assert paired_difference(a, b).effect == pytest.approx((favourable - unfavourable) / ranks.sum())
    signs = [np.sign(x - y) for x, y in itertools.product(a, b)]
    assert unpaired_difference(a, b).effect == pytest.approx(np.mean(signs))


def test_p_values_are_scipys() -> None:
    a, b = np.random.default_rng(4).normal(size=(2, 30)) + np.array([[0.4], [0.0]])
    assert paired_difference(a, b).p_value == stats.wilcoxon(a, b).pvalue
    assert unpaired_difference(a, b).p_value == stats.mannwhitneyu(a, b).pvalue


def test_few_pairs_tell_the_least_p_that_they_can_give() -> None:
    a = np.array([1.0, 2.0, 3.0])
    found = paired_difference(a, a + np.array([1.0, 1.1, 1.3]))
    assert found.p_value == found.least_p == 0.25
    assert (found.shift.low, found.shift.high) == (-np.inf, np.inf)


def test_holm_is_the_step_down_procedure() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.6]) == [1.0, 1.0]
    assert holm([]) == []


def test_equal_estimators_are_called_different_at_the_nominal_rate() -> None:
    """Three equal estimators side by side on common trials; the false-alarm rate is below 1e-6."""
    rng, runs, any_of_three, first_alone = np.random.default_rng(5), 500, 0, 0
    for _ in range(runs):
        common = rng.normal(size=20)
        errors = np.exp(common + 0.5 * rng.normal(size=(3, 20)))
        p = [paired_difference(errors[i], errors[j]).p_value for i, j in ((0, 1), (0, 2), (1, 2))]
        any_of_three += min(holm(p)) <= 0.05
        first_alone += p[0] <= 0.05
    low, high = stats.binom.interval(1 - 1e-6, runs, 0.05)
    assert any_of_three <= high  # the family errs no more than one test may
    assert low <= first_alone <= high  # and one test errs as often as it says


def test_trials_are_paired_by_seed_and_trial_whatever_their_order() -> None:
    at_a, at_b = pair([(1, 0), (1, 1), (2, 0)], [(2, 0), (1, 1), (3, 0)])
    assert at_a.tolist() == [1, 2]
    assert at_b.tolist() == [1, 0]
