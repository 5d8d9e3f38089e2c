"""The laws of rank tests against an enumeration of signs and partings, and the shifts that they accept."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from orchestrator.evidence.permutation import EXACT, accepted, rank_sum_test, signed_rank_test
from orchestrator.score.gather import Floats

Draw = Callable[[np.random.Generator, int], Floats]

TIED: dict[str, Draw] = {
    "counts": lambda rng, n: rng.integers(-2, 4, n).astype(float),
    "rare events": lambda rng, n: -(rng.random(n) < 0.3).astype(float),
    "half of them zero": lambda rng, n: np.where(rng.random(n) < 0.5, 0.0, rng.normal(0.5, 1.0, n)),
    "some of them infinite": lambda rng, n: np.where(rng.random(n) < 0.2, np.inf, rng.integers(-3, 2, n)),
    "never tied": lambda rng, n: rng.normal(0.5, 1.0, n),
}


@pytest.mark.parametrize("draw", TIED.values(), ids=TIED)
def test_the_signed_rank_test_is_that_of_every_sign_over_the_ranks_there_are(draw: Draw) -> None:
    rng = np.random.default_rng(1)
    for n in (1, 2, 5, 9, 9, 9):
        differences = draw(rng, n)
        ranks = stats.rankdata(np.abs(differences))
        seen = float(np.sum(np.sign(differences) * ranks))
        own = ranks[differences != 0.0]
        law = [abs(np.dot(signs, own)) for signs in itertools.product((-1.0, 1.0), repeat=own.size)]
        p_value, statistic = signed_rank_test(differences)
        assert p_value == pytest.approx(np.mean(np.array(law) >= abs(seen)), rel=1e-12)
        assert statistic == seen


@pytest.mark.parametrize("draw", TIED.values(), ids=TIED)
def test_the_rank_sum_test_is_that_of_every_parting_of_the_ranks_there_are(draw: Draw) -> None:
    rng = np.random.default_rng(2)
    for n, m in ((1, 3), (4, 5), (6, 4), (5, 5)):
        a, b = draw(rng, n), draw(rng, m)
        ranks = stats.rankdata(np.concatenate([a, b]))
        law = np.array([sum(own) for own in itertools.combinations(ranks, n)])
        seen = ranks[:n].sum()
        p_value, statistic = rank_sum_test(a, b)
        expected = min(1.0, 2.0 * min(np.mean(law <= seen), np.mean(law >= seen)))
        assert p_value == pytest.approx(expected, rel=1e-12)
        assert statistic == pytest.approx(seen - law.mean())


@pytest.mark.parametrize("trials", [4, 13, 14, 20, 50, 51, 100, 1000])
def test_trials_that_tell_nothing_do_not_change_the_p_value(trials: int) -> None:
    differences = np.zeros(trials)
    differences[:4] = -1.0
    assert signed_rank_test(differences)[0] == 0.125  # of four signs all are alike in 2 of 16 cases


def test_beyond_the_exact_limit_the_normal_law_is_close_to_the_exact_one() -> None:
    rng = np.random.default_rng(3)
    differences = rng.normal(0.25, 1.0, EXACT + 10)
    exact = stats.wilcoxon(differences, method="exact").pvalue
    assert signed_rank_test(differences)[0] == pytest.approx(exact, rel=0.03)
    a, b = rng.normal(0.5, 1.0, 30), rng.normal(0.0, 1.0, 25)
    assert rank_sum_test(a, b)[0] == pytest.approx(stats.mannwhitneyu(a, b, method="exact").pvalue, rel=0.03)


def test_beyond_the_exact_limit_ties_and_zeros_have_their_part_in_the_variance() -> None:
    rng = np.random.default_rng(4)
    differences = rng.integers(-3, 5, 120).astype(float)
    expected = stats.wilcoxon(differences, zero_method="pratt").pvalue
    assert signed_rank_test(differences)[0] == pytest.approx(expected, rel=1e-12)
    a, b = rng.integers(0, 5, 40).astype(float), rng.integers(0, 6, 35).astype(float)
    assert rank_sum_test(a, b)[0] == pytest.approx(stats.mannwhitneyu(a, b).pvalue, rel=1e-12)


def every_cell(steps: Floats) -> list[float]:
    """Return each step and a shift in each gap around them: the test has no other answers."""
    between = [steps[0] - 1.0, *(0.5 * (steps[1:] + steps[:-1])), steps[-1] + 1.0]
    return [x for pair in itertools.zip_longest(between, steps) for x in pair if x is not None]


def hull(steps: Floats, test: Callable[[float], tuple[float, float]], level: float) -> tuple[float, float]:
    """Return the ends of the accepted shifts by asking about every one."""
    held = [at for at, shift in enumerate(every_cell(steps)) if test(shift)[0] > level]
    if not held:
        return np.nan, np.nan
    low = -np.inf if held[0] == 0 else steps[(held[0] - 1) // 2]
    high = np.inf if held[-1] == 2 * steps.size else steps[held[-1] // 2]
    return low, high


@pytest.mark.parametrize("draw", TIED.values(), ids=TIED)
def test_the_ends_are_those_of_an_enumeration_of_all_shifts(draw: Draw) -> None:
    rng = np.random.default_rng(5)
    for n in (4, 7, 12, 20, 20, 60):
        differences = draw(rng, n)
        known = differences[np.isfinite(differences)]
        steps = np.unique(0.5 * (known[:, None] + known[None, :]))

        def paired(by: float, differences: Floats = differences) -> tuple[float, float]:
            return signed_rank_test(differences - by)

        np.testing.assert_equal(accepted(steps, paired, 0.05), hull(steps, paired, 0.05))
        a, b = differences[: n // 2], draw(rng, n // 2)
        with np.errstate(invalid="ignore"):
            apart = np.unique(a[:, None] - b[None, :])
        apart = apart[np.isfinite(apart)]

        def unpaired(by: float, a: Floats = a, b: Floats = b) -> tuple[float, float]:
            return rank_sum_test(a - by, b)

        np.testing.assert_equal(accepted(apart, unpaired, 0.05), hull(apart, unpaired, 0.05))


def test_where_every_shift_is_rejected_none_is_given() -> None:
    differences = np.zeros(40)
    differences[:6] = -1.0  # at 0 all six are negative; beside 0 all the others are
    steps = np.array([-1.0, -0.5, 0.0])
    assert signed_rank_test(differences)[0] == 2**-5
    assert np.isnan(accepted(steps, lambda by: signed_rank_test(differences - by), 0.05)).all()


def test_the_largest_numbers_there_are_have_an_interval() -> None:
    most = np.finfo(np.float64).max
    differences = most * np.array([-1.0, -0.9, -0.8, 0.7, 0.9, 0.95, 1.0])
    i, j = np.triu_indices(7)
    steps = np.unique(0.5 * differences[i] + 0.5 * differences[j])
    low, high = accepted(steps, lambda by: signed_rank_test(differences - by), 0.05)
    assert -most <= low < high <= most
