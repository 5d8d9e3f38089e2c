import numpy as np
import pytest
from scipy.stats import chi2

from bus.packets import Packet
from nodes.contract import Setting
from nodes.estimators.dead_reckoning import DeadReckoning
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear
from nodes.plants.planar_robot import PlanarRobot

FALSE_ALARM = 1e-6


def test_its_errors_are_as_large_as_it_claims_whatever_it_is_sent(packet):
    runs, steps, nees = 300, 8, 0.0
    plant = PlanarRobot(1.0, initial=Gaussian(std=0.02, mean=[1.5, 0.2, 0.0]))
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        state = plant.initial_state(rng)
        dead = DeadReckoning(Setting("d", plant, {}, {}, rng), start_error=Gaussian(std=0.03))
        for step in range(steps):
            state = plant.advance(step, state, rng) if step else state
            assert dead.correct(step, [packet(step, "s1", [99.0, 99.0])]) is None
        belief = dead.estimate(steps - 1)
        nees += float((belief.state - state) @ np.linalg.solve(belief.covariance, belief.state - state))
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=3 * runs)
    assert low < nees < high


def test_it_follows_what_is_commanded():
    plant = Linear(
        1.0,
        A=[[1.0, 1.0], [0.0, 1.0]],
        B=[[0.0], [2.0]],
        process_noise=Gaussian(std=0.1),
        initial=Gaussian(std=0.0, mean=[1.0, 0.0]),
    )
    dead = DeadReckoning(Setting("d", plant, {}, {}, np.random.default_rng(0)))
    dead.correct(0, [])
    dead.control(0, [Packet("c1", 0, 0, "control", np.array([0.5]))])
    dead.correct(1, [])
    np.testing.assert_allclose(dead.estimate(1).state, [1.0, 1.0])
    np.testing.assert_allclose(dead.estimate(1).covariance, 0.01 * np.eye(2))


def test_a_start_error_of_another_size_is_refused():
    with pytest.raises(ValueError, match="std has 2 entries, expected 1 or 3"):
        DeadReckoning(
            Setting("d", PlanarRobot(1.0), {}, {}, np.random.default_rng(0)),
            start_error=Gaussian(std=[1.0, 1.0]),
        )
