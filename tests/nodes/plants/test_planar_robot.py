import math

import numpy as np
import pytest
from scipy.stats import chi2

from nodes.contract import NonlinearPlant, SampledPlant
from nodes.gaussian import Gaussian
from nodes.plants.planar_robot import LAP, PlanarRobot
from nodes.remainders import BoundedPlant, drawn_within, rotation_remainder

FALSE_ALARM = 1e-6


def test_it_drives_one_counter_clockwise_lap_with_its_default_inputs():
    plant = PlanarRobot(1.0)
    path = [plant.initial_mean]
    for _ in range(LAP):
        path.append(plant.transition(path[-1][None])[0])
    corners = np.array(path)[:, :2]
    centre = corners[:-1].mean(axis=0)
    radius = 0.5 * 0.2 / math.sin(math.pi / LAP)
    np.testing.assert_allclose(path[-1], path[0] + [0.0, 0.0, 2.0 * math.pi], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(corners - centre, axis=1), radius, rtol=1e-12)
    x, y = corners.T
    assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0.0


def test_its_jacobian_is_the_derivative_of_its_transition():
    plant, state, h = PlanarRobot(1.0, forward=0.7, turn=-0.3), np.array([0.3, -2.0, 2.1]), 1e-6
    steps = h * np.eye(3)
    numeric = (plant.transition(state + steps) - plant.transition(state - steps)).T / (2.0 * h)
    np.testing.assert_allclose(plant.jacobian(state), numeric, atol=1e-9)
    assert isinstance(plant, NonlinearPlant)
    assert isinstance(plant, SampledPlant)


@pytest.mark.parametrize("spread", [0.05, 0.5, 3.0, 20.0])
def test_the_remainder_of_its_linearisation_stays_below_the_bound(spread):
    plant, rng = PlanarRobot(1.0), np.random.default_rng(1)
    assert isinstance(plant, BoundedPlant)
    covariance = np.diag([0.1, 0.2, spread**2])
    errors = np.array([drawn_within(1.0, 3, rng) for _ in range(4000)]) @ np.sqrt(covariance)
    errors[:2, 2] = [spread, -spread]
    state = np.array([1.0, 2.0, 0.7])
    left = plant.transition(state + errors) - plant.transition(state[None]) - errors @ plant.jacobian(state).T
    bound = plant.remainder_bound(state, covariance) * np.abs(errors @ plant.remainder_driver)
    assert np.all(np.linalg.norm(left, axis=1) <= bound + 1e-12)
    outside = np.eye(3) - plant.remainder_directions @ plant.remainder_directions.T
    assert np.abs(left @ outside).max() < 1e-14


def test_the_bound_of_a_rotation_holds_at_every_angle():
    for largest in (0.1, 1.0, 3.0, 10.0):
        angles = np.linspace(-largest, largest, 4001)
        left = np.hypot(np.cos(angles) - 1.0, np.sin(angles) - angles)
        assert np.all(left <= rotation_remainder(largest) * np.abs(angles) + 1e-12)


def test_its_noise_has_the_covariance_that_it_claims():
    plant, rng, runs = PlanarRobot(1.0), np.random.default_rng(0), 4000
    state = np.array([1.0, 1.0, 1.0])
    moved = np.array([plant.advance(1, state, rng) for _ in range(runs)]) - plant.transition(state[None])
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=3 * runs)
    assert low < np.sum(moved**2 / np.diag(plant.Q)) < high


def test_bounded_noise_is_never_longer_than_its_bound_and_takes_the_same_draws():
    free, held = PlanarRobot(1.0), PlanarRobot(1.0, noise_bound=1.5)
    state = np.zeros(3)
    one, other = np.random.default_rng(5), np.random.default_rng(5)
    lengths = []
    for _ in range(500):
        a, b = free.advance(1, state, one), held.advance(1, state, other)
        nominal = held.transition(state[None])[0]
        lengths.append(np.linalg.norm((b - nominal) / np.sqrt(np.diag(held.Q))))
        if lengths[-1] < 1.5 - 1e-9:
            np.testing.assert_array_equal(a, b)
    assert max(lengths) == pytest.approx(1.5)
    assert min(lengths) < 1.0
    start = (held.initial_state(np.random.default_rng(i)) - held.initial_mean for i in range(200))
    assert max(np.linalg.norm(each) for each in start) == pytest.approx(0.15)


def test_laws_of_another_size_are_refused():
    with pytest.raises(ValueError, match="std has 2 entries, expected 1 or 3"):
        PlanarRobot(1.0, process_noise=Gaussian(std=[1.0, 1.0]))
