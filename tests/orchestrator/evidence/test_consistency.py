"""A filter that is consistent by construction passes in 95 % of campaigns, and others do not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from orchestrator.evidence.consistency import by_step, overall_by_trial, overall_independent
from orchestrator.evidence.whiteness import standardised_nis, whiteness

A, Q, R, LOSS = 0.95, 0.1, 0.5, 0.2


def campaigns(
    rng: np.random.Generator, number: int, trials: int, steps: int, *, believed_q: float = Q
) -> tuple[np.ndarray, ...]:
    """Return NEES, NIS, its degrees of freedom and whitened innovations, each (number, trials, steps).

    A scalar Kalman filter, started in its stationary law, loses a fifth of its packets.
    """
    shape = (number, trials)
    x, estimate, P = rng.normal(size=shape), np.zeros(shape), np.ones(shape)
    columns: list[list[np.ndarray]] = [[], [], [], []]
    for k in range(steps):
        if k:
            x = A * x + np.sqrt(Q) * rng.normal(size=shape)
            estimate, P = A * estimate, A**2 * P + believed_q
        came = rng.random(shape) >= LOSS
        S, innovation = P + R, x + np.sqrt(R) * rng.normal(size=shape) - estimate
        gain = np.where(came, P / S, 0.0)
        estimate, P = estimate + gain * innovation, (1.0 - gain) * P
        white = np.where(came, innovation / np.sqrt(S), np.nan)
        figures = ((x - estimate) ** 2 / P, np.where(came, white**2, np.nan), came.astype(np.int64), white)
        for column, figure in zip(columns, figures, strict=True):
            column.append(figure)
    return tuple(np.stack(column, axis=2) for column in columns)


def within(passed: int, runs: int, rate: float = 0.95, slack: float = 0.0) -> bool:
    """Return whether a count agrees with a rate; the false-alarm rate is below 1e-6."""
    return bool(
        stats.binom.ppf(5e-7, runs, rate - slack) <= passed <= stats.binom.ppf(1 - 5e-7, runs, rate + slack)
    )


def test_a_consistent_filter_passes_in_95_percent_of_campaigns() -> None:
    runs = 1000
    nees, nis, dof, white = campaigns(np.random.default_rng(1), runs, 20, 50)
    ones = np.ones((20, 50), dtype=np.int64)
    results = [
        (
            overall_by_trial(nees[i], ones).judgement == "consistent",
            overall_independent(nis[i], dof[i]).judgement == "consistent",
            whiteness(white[i][:, :, None]).is_white(),
            whiteness(standardised_nis(nis[i], dof[i])).is_white(),
        )
        for i in range(runs)
    ]
    by_nees, by_nis, by_whiteness, by_nis_whiteness = np.sum(results, axis=0)
    assert within(by_nees, runs, slack=0.01)  # Student's interval of a skew mean: not exact
    assert within(by_nis, runs)
    assert within(by_whiteness, runs, slack=0.01)
    assert within(by_nis_whiteness, runs, slack=0.02)


def test_a_consistent_filter_is_within_the_bounds_of_a_step_in_95_percent_of_campaigns() -> None:
    runs = 1500
    nees, nis, dof, _ = campaigns(np.random.default_rng(2), runs, 10, 12)
    ones = np.ones((10, 12), dtype=np.int64)
    last = [(by_step(nees[i], ones), by_step(nis[i], dof[i])) for i in range(runs)]
    inside = np.sum(
        [[part.low[-1] <= part.ratio[-1] <= part.high[-1] for part in both] for both in last], axis=0
    )
    assert within(inside[0], runs)
    assert within(inside[1], runs)  # with a different number of packets in every campaign


def test_treating_nees_as_independent_over_steps_would_condemn_consistent_filters() -> None:
    nees, *_ = campaigns(np.random.default_rng(3), 300, 20, 50)
    ones = np.ones((20, 50), dtype=np.int64)
    passed = sum(overall_independent(nees[i], ones).judgement == "consistent" for i in range(300))
    assert passed < 0.85 * 300  # why campaigns are judged by the spread of their trials


def test_a_filter_that_believes_too_little_noise_is_overconfident_and_its_innovations_are_not_white() -> None:
    nees, nis, dof, white = campaigns(np.random.default_rng(4), 1, 20, 100, believed_q=Q / 10)
    ones = np.ones((20, 100), dtype=np.int64)
    assert overall_by_trial(nees[0], ones).judgement == "overconfident"
    assert overall_independent(nis[0], dof[0]).judgement == "overconfident"
    assert not whiteness(white[0][:, :, None]).is_white()
    nees, *_ = campaigns(np.random.default_rng(5), 1, 20, 100, believed_q=Q * 10)
    assert overall_by_trial(nees[0], ones).judgement == "conservative"


def test_the_bounds_of_a_step_are_chi_squares_of_all_that_arrived() -> None:
    figures = np.array([[2.0, np.nan], [3.0, 5.0]])
    dof = np.array([[1, 0], [2, 3]])
    found = by_step(figures, dof, confidence=0.9)
    assert found.ratio.tolist() == pytest.approx([5.0 / 3, 5.0 / 3])
    assert found.dof.tolist() == [3, 3]
    assert found.samples.tolist() == [2, 1]
    assert found.low[0] == pytest.approx(stats.chi2.ppf(0.05, 3) / 3)
    assert found.high[1] == pytest.approx(stats.chi2.ppf(0.95, 3) / 3)


def test_attack_on_and_off_are_judged_apart() -> None:
    _, nis, dof, _ = campaigns(np.random.default_rng(6), 1, 20, 60)
    attacked = np.zeros((20, 60), dtype=bool)
    attacked[:, 30:] = True
    hit = nis[0] * np.where(attacked, 3.0, 1.0)
    assert overall_independent(hit, dof[0], attacked).judgement == "overconfident"
    assert overall_independent(hit, dof[0], ~attacked).judgement == "consistent"


def test_autocorrelation_is_the_time_average_of_its_definition() -> None:
    e = np.random.default_rng(7).normal(size=(3, 20, 2))
    e[1, 4, 0] = np.nan
    found = whiteness(e, lags=3)
    pairs = [
        (e[i, k, j], e[i, k + 2, j])
        for i in range(3)
        for k in range(18)
        for j in range(2)
        if not np.isnan(e[i, k, j] + e[i, k + 2, j])
    ]
    a, b = np.array(pairs).T
    assert found.pairs[1] == len(pairs) == 106
    assert found.correlation[1] == pytest.approx(np.sum(a * b) / np.sqrt(np.sum(a**2) * np.sum(b**2)))
    assert found.bound[1] == pytest.approx(stats.norm.ppf(0.975) / np.sqrt(106))


def test_bounds_within_which_a_filter_ten_times_too_careful_would_be_give_no_verdict() -> None:
    ones = np.ones((2, 1), dtype=np.int64)
    found = overall_by_trial(np.array([[0.5], [1.5]]), ones)
    assert found.low < 0.1 < found.ratio < found.high
    assert found.judgement == "unknown"
    same = overall_by_trial(np.array([[0.99], [1.01]]), ones)
    assert same.judgement == "consistent"


def test_a_filter_lost_in_one_trial_of_four_is_overconfident_however_far_its_trials_differ() -> None:
    figures = np.array([[1.0], [1.1], [0.9], [1e17]])
    assert overall_by_trial(figures, np.ones(figures.shape, dtype=np.int64)).judgement == "overconfident"


@pytest.mark.parametrize(("trials", "steps"), [(5, 50), (10, 6), (20, 6), (100, 6)])
def test_few_trials_and_few_steps_condemn_hardly_more_consistent_filters_than_many(
    trials: int, steps: int
) -> None:
    runs, rng = 1000, np.random.default_rng(trials)
    error = np.empty((runs, trials, steps))
    error[..., 0] = rng.normal(size=(runs, trials))
    for k in range(1, steps):
        error[..., k] = 0.9 * error[..., k - 1] + np.sqrt(1.0 - 0.9**2) * rng.normal(size=(runs, trials))
    ones = np.ones((trials, steps), dtype=np.int64)
    found = [overall_by_trial(own**2, ones) for own in error]
    condemned = [own.ratio < own.low for own in found], [own.ratio > own.high for own in found]
    too_careful, too_sure = np.mean(condemned, axis=1)
    assert too_careful < 0.085  # 5.4 % of 4,000 campaigns; 12 % with Student's interval of the mean
    assert too_sure < 0.045
    assert too_careful + too_sure < 0.11


def test_estimators_that_share_their_trial_are_put_together_before_trials_are_compared() -> None:
    runs, trials, steps, nodes = 400, 8, 20, 6
    shared = np.random.default_rng(8).normal(size=(runs, trials, 1, steps))
    figures = np.repeat(shared**2, nodes, axis=2).reshape(runs, trials * nodes, steps)
    dof = np.ones((trials * nodes, steps), dtype=np.int64)
    trial = np.repeat(np.arange(trials), nodes)
    passed = sum(overall_by_trial(own, dof, trial=trial).judgement == "consistent" for own in figures)
    assert within(passed, runs, slack=0.03)
    alone = sum(overall_by_trial(own, dof).judgement == "consistent" for own in figures)
    assert alone < 0.8 * runs  # what it would be if each counted as a trial
    one = overall_by_trial(figures[0, :nodes], dof[:nodes], trial=trial[:nodes])
    assert one.judgement == "unknown"


def test_one_trial_gives_no_verdict_on_nees_and_nothing_gives_nothing() -> None:
    assert overall_by_trial(np.ones((1, 9)), np.ones((1, 9), dtype=np.int64)).judgement == "unknown"
    assert (
        overall_independent(np.full((2, 3), np.nan), np.zeros((2, 3), dtype=np.int64)).judgement == "unknown"
    )
