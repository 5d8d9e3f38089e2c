"""Rank statistics against their definitions, and how often they call equals different."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from orchestrator.evidence.permutation import signed_rank_test
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


def test_the_interval_holds_no_shift_that_the_test_rejects_though_most_are_tied() -> None:
    """Rare events in one of two: 0 is held where the test does not reject it, and no shift where it does."""
    for trials, events, held in ((13, 4, True), (14, 4, True), (100, 4, True), (20, 5, True), (40, 6, False)):
        a, b = np.zeros(trials), np.zeros(trials)
        b[:events] = 1.0
        found = paired_difference(a, b)
        assert found.p_value == 2.0 ** (1 - events)
        assert found.shift.holds(0.0) is held, (trials, events)
        assert not found.is_shift


def test_rare_events_are_told_by_their_means_and_by_who_is_lower_where_they_differ() -> None:
    a, b = np.zeros(100), np.zeros(100)
    b[:14] = 1.0
    found = paired_difference(a, b)
    assert found.means == (0.0, 0.14)
    assert found.smaller is not None
    expected = stats.binomtest(14, 14).proportion_ci(method="exact")
    assert (found.smaller.value, found.smaller.low) == (1.0, pytest.approx(expected.low))
    unpaired = unpaired_difference(a, b)
    assert not unpaired.is_shift
    assert unpaired.smaller is None
    assert paired_difference(b + np.arange(100.0), a + 2 * np.arange(100.0)).is_shift


def test_the_interval_of_the_share_and_the_p_value_agree_where_all_differences_are_as_large() -> None:
    rng = np.random.default_rng(7)
    for trials in rng.integers(10, 45, 60):
        a, b = (rng.random((2, trials)) < np.array([[0.1], [0.5]])).astype(float)
        found = paired_difference(a, b)
        if found.smaller is not None:
            assert (found.p_value > 0.05) == found.smaller.holds(0.5)


def test_the_side_is_that_of_the_statistic_that_was_tested() -> None:
    differences = np.concatenate([np.zeros(40), np.ones(25), np.full(12, -10.0)])
    found = paired_difference(differences, np.zeros(77))
    assert found.statistic == 25 * (40 + 13) - 12 * (65 + 6.5)  # zeros keep their ranks
    assert found.statistic > 0.0 > found.effect


def test_infinite_values_that_stand_alone_are_counted_and_the_others_told_apart() -> None:
    a, b = np.array([1.0, np.inf, np.inf, 2.0]), np.array([2.0, np.inf, 3.0, 1.0])
    found = paired_difference(a, b)
    assert (found.infinite, found.infinite_alone) == ((2, 1), (1, 0))
    assert found.finite is not None
    assert (found.finite.sizes, found.finite.counts) == ((2, 2), (1, 0, 1))
    assert paired_difference(b, b).finite is None
    unpaired = unpaired_difference(a, b[:2])
    assert unpaired.infinite_alone == (2, 1)
    assert unpaired.finite is not None
    assert unpaired.finite.sizes == (2, 1)


def test_pairs_are_counted_by_which_is_the_smaller() -> None:
    a, b = np.array([1.0, 2.0, 3.0, np.inf, np.inf]), np.array([2.0, 2.0, 1.0, np.inf, 1.0])
    assert paired_difference(a, b).counts == (1, 2, 2)


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
    assert paired_difference(a, b).p_value == pytest.approx(stats.wilcoxon(a, b).pvalue, rel=1e-12)
    assert unpaired_difference(a, b).p_value == pytest.approx(stats.mannwhitneyu(a, b).pvalue, rel=1e-12)
    a, b = a[:20], b[:20]
    exact = stats.mannwhitneyu(a, b, method="exact").pvalue
    assert unpaired_difference(a, b).p_value == pytest.approx(exact, rel=1e-12)


def test_few_pairs_tell_the_least_p_that_they_can_give() -> None:
    a = np.array([1.0, 2.0, 3.0])
    found = paired_difference(a, a + np.array([1.0, 1.1, 1.3]))
    assert found.p_value == found.least_p == 0.25
    assert (found.shift.low, found.shift.high) == (-np.inf, np.inf)


def test_a_thousand_trials_of_each_are_compared_unpaired() -> None:
    a, b = np.random.default_rng(9).normal(size=(2, 1000))
    found = unpaired_difference(a, b + 1.0)
    assert found.least_p == 0.0  # 2 over a number with 600 digits
    assert found.shift.holds(-1.0)


def test_holm_is_the_step_down_procedure() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.6]) == [1.0, 1.0]
    assert holm([]) == []


def test_equal_estimators_are_called_different_at_the_nominal_rate() -> None:
    """Three equal estimators side by side on common trials; the false-alarm rate is below 1e-6."""
    rng, runs, any_of_three, first_alone = np.random.default_rng(5), 250, 0, 0
    for _ in range(runs):
        common = rng.normal(size=20)
        errors = np.exp(common + 0.5 * rng.normal(size=(3, 20)))
        p = [paired_difference(errors[i], errors[j]).p_value for i, j in ((0, 1), (0, 2), (1, 2))]
        any_of_three += min(holm(p)) <= 0.05
        first_alone += p[0] <= 0.05
    low, high = stats.binom.interval(1 - 1e-6, runs, 0.05)
    assert any_of_three <= high  # the family errs no more than one test may
    assert low <= first_alone <= high  # and one test errs as often as it says


def test_equals_with_rare_events_are_called_different_at_most_at_the_nominal_rate() -> None:
    """Counts of 0 and 1 with the same chance in both; the false-alarm rate is below 1e-6 for each number."""
    rng, runs = np.random.default_rng(6), 600
    for trials, chance in ((20, 0.1), (40, 0.055), (100, 0.02), (100, 0.4), (300, 0.3)):
        a, b = (rng.random((2, runs, trials)) < chance).astype(float)
        wrong = sum(signed_rank_test(a[i] - b[i])[0] <= 0.05 for i in range(runs))
        assert wrong <= stats.binom.ppf(1 - 1e-6, runs, 0.05), (trials, chance)


def test_a_true_difference_is_found_as_often_as_by_the_test_without_ties() -> None:
    """A shift of 0.6 standard deviations in 30 pairs, in values to one decimal; Student's power is 0.88."""
    rng, runs = np.random.default_rng(8), 300
    differences = np.round(rng.normal(0.6, 1.0, (runs, 30)), 1)
    found = sum(paired_difference(own, np.zeros(30)).p_value <= 0.05 for own in differences)
    assert found >= stats.binom.ppf(1e-6, runs, 0.85)


def test_trials_are_paired_by_seed_and_trial_whatever_their_order() -> None:
    at_a, at_b = pair([(1, 0), (1, 1), (2, 0)], [(2, 0), (1, 1), (3, 0)])
    assert at_a.tolist() == [1, 2]
    assert at_b.tolist() == [1, 0]
