import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nodes.contract import LinearPlant
from nodes.estimators.attack_model import SmoothPlant
from nodes.gaussian import Gaussian
from nodes.plants.ieee14 import Ieee14
from nodes.plants.sine_swing import SineIeee14, SineSwingNetwork
from nodes.plants.swing_network import Machine

SILENT = {"process_noise": Gaussian(std=0.0), "initial": Gaussian(std=0.1)}


@pytest.fixture
def plant():
    return SineIeee14(0.01, **SILENT)


def exact(network, state, load, seconds):
    """Integrate the swing equation as it is written, pair by pair, by another library."""
    M, b, g = network.inertias, -network.reduced.stiffness, len(network.inertias)

    def swing(_, x):
        angles, rates = x[:g], x[g:]
        pull = [sum(b[i, j] * np.sin(angles[i] - angles[j]) for j in range(g) if j != i) for i in range(g)]
        return np.concatenate((rates, (-network.damping * rates - pull - network.load_shares @ load) / M))

    return solve_ivp(swing, (0.0, seconds), state, rtol=1e-11, atol=1e-12).y[:, -1]


def test_large_swings_under_an_altered_load_follow_the_swing_equation(plant):
    rng, load = np.random.default_rng(0), np.array([0.2, 0.1])
    start = np.concatenate((rng.uniform(-2.0, 2.0, 5), rng.normal(0.0, 1.0, 5)))
    state = start
    for step in range(1, 51):
        state = plant.advance(step, state, rng, attack=load)
    np.testing.assert_allclose(state, exact(Ieee14(0.01), start, load, 0.5), rtol=1e-7, atol=1e-7)


def test_many_states_are_moved_as_each_of_them_is(plant):
    rng = np.random.default_rng(1)
    states, signals = rng.normal(size=(7, 10)), rng.normal(size=(7, 2))
    moved = plant.transition(states, signals)
    one_by_one = [plant.transition(x[None], a[None])[0] for x, a in zip(states, signals, strict=True)]
    np.testing.assert_allclose(moved, one_by_one, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(plant.transition(states), plant.transition(states, np.zeros((7, 2))))


def test_small_swings_are_those_of_the_small_signal_network(plant):
    """What is left out of the sine is of third order: a thousandth of the angles leaves a billionth."""
    linear, rng = Ieee14(0.01), np.random.default_rng(2)
    state, load = 1e-3 * rng.normal(size=10), 1e-3 * np.array([0.2, 0.1])
    moved = plant.transition(state[None], load[None])[0]
    np.testing.assert_allclose(moved, linear.A @ state + linear.G @ load, rtol=1e-5, atol=1e-9)


def test_machines_that_all_turn_alike_feel_no_pull(plant):
    state = np.concatenate((np.full(5, 40.0), np.zeros(5)))
    np.testing.assert_allclose(plant.transition(state[None])[0], state, atol=1e-11)


def test_the_tables_of_a_network_make_the_plant_and_the_signal_can_be_scaled_or_absent():
    tables = {
        "branches": [[1, 2, 0.5]],
        "machines": [Machine(1, 5.0, 0.2, 1.0), Machine(2, 4.0, 0.3, 2.0)],
        **SILENT,
    }
    scaled = SineSwingNetwork(0.01, **tables, attacked_buses=[2], attack_scale=3.0)
    plain = SineSwingNetwork(0.01, **tables, attacked_buses=[2])
    at = np.zeros((1, 4))
    np.testing.assert_allclose(
        scaled.transition(at, np.array([[0.1]])), plain.transition(at, np.array([[0.3]])), rtol=1e-12
    )
    assert SineSwingNetwork(0.01, **tables).signal_size == 0
    assert isinstance(plain, SmoothPlant)
    assert not isinstance(plain, LinearPlant)
    assert plain.state_groups == {"angles": [0, 1], "frequencies": [2, 3]}


def test_noise_and_initial_law_are_those_that_were_given():
    plant = SineIeee14(0.01, process_noise=Gaussian(std=0.2), initial=Gaussian(std=0.3, mean=[0.5] * 10))
    rng = np.random.default_rng(3)
    draws = np.array([plant.advance(1, np.zeros(10), rng) for _ in range(4000)])
    np.testing.assert_allclose(draws.std(axis=0), 0.2, rtol=0.05)
    np.testing.assert_allclose(plant.initial_mean, 0.5)
    np.testing.assert_allclose(plant.initial_covariance, 0.09 * np.eye(10))
