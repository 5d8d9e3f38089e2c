"""What Ding 2021, section V shows, and what it does not: the secure filter under its cases A and B.

The quick figures come from few trials and have wide ranges; ``-m slow`` takes 100 trials. ``-s`` prints them.
"""

import numpy as np
import pytest

NODE_4, NODE_12, NODE_20 = 3, 11, 19
QUICK, FULL = 5, 100
ONE_STEP = {"s4": (15.0, 90, 90), "s12": (15.0, 50, 50)}

pytestmark = pytest.mark.timeout(600)

trials = pytest.mark.parametrize("trials", [QUICK, pytest.param(FULL, marks=pytest.mark.slow)])


@pytest.mark.parametrize("steps", [30, pytest.param(150, marks=pytest.mark.slow)])
def test_the_detectors_covariance_is_constant_because_the_minimum_takes_its_eigenvalue_branch(
    network, methods, steps
):
    play = network.play(network.scenario(0, steps), methods["secure"]())
    for node in range(20):
        traces = [row[node].diagnostics["detector_covariance_trace"] for row in play.beliefs[2:]]
        assert traces == pytest.approx([0.8481 if node < 7 else 0.7081] * len(traces), rel=0.01)


@trials
def test_without_attack_the_errors_are_those_of_the_papers_method_and_fixed_gains_do_as_well(
    campaign, trials
):
    low, high = {QUICK: (0.20, 0.40), FULL: (0.265, 0.30)}[trials]
    secure = campaign("secure", {}, trials)
    fixed = campaign("fixed_gain", {}, trials)
    print(
        f"\ncase A, {trials} trials:",
        [(round(secure.rmse(i), 3), round(fixed.rmse(i), 3)) for i in (3, 11, 19)],
    )
    assert low < secure.rmse(NODE_12) < high
    assert 0.95 < fixed.rmse(NODE_12) / secure.rmse(NODE_12) < {QUICK: 1.12, FULL: 1.06}[trials]
    assert np.all(secure.alarms == 0.0)


@trials
def test_every_attacked_sample_is_rejected_and_the_median_trial_does_not_suffer(campaign, case_b, trials):
    quiet, attacked = campaign("secure", {}, trials), campaign("secure", case_b, trials)
    ratio = np.median(np.sqrt(attacked.position_mse / quiet.position_mse), axis=0)
    print(f"\ncase B over A, {trials} trials: median {ratio[[3, 11, 19]].round(3)},", end=" ")
    print("pooled", [round(attacked.rmse(i) / quiet.rmse(i), 2) for i in (3, 11, 19)])
    assert np.all(attacked.accepted == 0.0)
    assert ratio[NODE_4] < {QUICK: 1.25, FULL: 1.10}[trials]
    assert ratio[NODE_12] < {QUICK: 1.25, FULL: 1.10}[trials]
    assert 0.98 < attacked.rmse(NODE_20) / quiet.rmse(NODE_20) < 1.02


@trials
def test_in_the_attacked_steps_the_detector_keeps_the_errors_small_and_the_others_do_not(
    campaign, case_b, trials
):
    quiet = campaign("secure", {}, trials).window_mse.mean(axis=0)
    secure = np.sqrt(campaign("secure", case_b, trials).window_mse.mean(axis=0) / quiet)
    blind = np.sqrt(campaign("secure", case_b, trials, detector="off").window_mse.mean(axis=0) / quiet)
    fixed = np.sqrt(campaign("fixed_gain", case_b, trials).window_mse.mean(axis=0) / quiet)
    print(f"\nattacked steps over A: secure {secure.round(2)}, off {blind.round(2)}, fixed {fixed.round(2)}")
    assert np.all(secure <= {QUICK: 4.5, FULL: 3.3}[trials])
    assert np.all(blind >= {QUICK: 6.0, FULL: 9.0}[trials])
    assert np.all(fixed >= {QUICK: 6.0, FULL: 9.0}[trials])


@pytest.mark.slow
def test_an_attack_of_six_steps_locks_some_trials_out_for_good_and_one_of_one_step_hardly_any(
    campaign, case_b
):
    long = campaign("secure", case_b, FULL).locked_out
    short = campaign("secure", ONE_STEP, FULL).locked_out
    shares = [locked.any(axis=1).mean() for locked in (long, short)]
    print(f"\nlocked out: six steps {long.mean(axis=0)}, either node {shares[0]}; one step {shares[1]}")
    assert 0.03 <= shares[0] <= 0.35
    assert shares[1] <= 0.03


@trials
def test_readmission_by_the_neighbours_ends_the_lock_out_and_lets_almost_nothing_in(campaign, case_b, trials):
    quiet = campaign("secure", {}, trials)
    cured = campaign("secure", case_b, trials, readmission="neighbours")
    assert not cured.locked_out.any()
    assert cured.accepted.mean() < 0.05
    assert cured.rmse(NODE_4) < 1.5 * quiet.rmse(NODE_4)
    assert cured.rmse(NODE_12) < 1.5 * quiet.rmse(NODE_12)


@trials
@pytest.mark.parametrize("remedy", [{"detector": "upper_bound"}, {"readmission": "own_bound"}])
def test_the_own_upper_bound_ends_the_lock_out_at_the_price_of_a_part_of_the_attack(
    campaign, case_b, trials, remedy
):
    cured = campaign("secure", case_b, trials, **remedy)
    assert not cured.locked_out.any()
    assert 0.05 < cured.accepted.mean() < 0.6


@pytest.mark.slow
@pytest.mark.parametrize("strength", [4.0, 8.0, 15.0, 30.0])
@pytest.mark.parametrize(
    "remedy",
    [{}, {"detector": "upper_bound"}, {"readmission": "own_bound"}, {"readmission": "neighbours"}],
    ids=str,
)
def test_the_trade_off_between_what_is_let_in_and_who_is_locked_out(campaign, strength, remedy):
    attacks = {"s4": (strength, 90, 95), "s12": (strength, 50, 55)}
    result = campaign("secure", attacks, 50, **remedy)
    locked = result.locked_out.any(axis=1).mean()
    print(
        f"\n{strength} {remedy}: let in {result.accepted.mean():.3f}, locked out {locked:.2f}, "
        f"rmse {result.rmse(NODE_4):.2f} {result.rmse(NODE_12):.2f}"
    )
    assert bool(remedy) <= (locked == 0.0)
