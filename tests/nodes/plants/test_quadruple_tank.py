import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from nodes.contract import NonlinearPlant, SampledPlant
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear
from nodes.plants.quadruple_tank import QuadrupleTank

FALSE_ALARM = 1e-6
LEVELS = {
    "minimum": [12.263, 12.783, 1.634, 1.409],
    "non_minimum": [12.442, 13.167, 4.73, 4.986],
}


def rates(t, h):
    """Return the rates of change (4,) at the minimum-phase operating point, as Johansson 2000 writes them."""
    q = np.array([0.071, 0.057, 0.071, 0.057]) * np.sqrt(2.0 * 981.0 * np.maximum(h, 0.0))
    return np.array(
        [
            (-q[0] + q[2] + 0.7 * 3.33 * 3.0) / 28.0,
            (-q[1] + q[3] + 0.6 * 3.35 * 3.0) / 32.0,
            (-q[2] + 0.4 * 3.35 * 3.0) / 28.0,
            (-q[3] + 0.3 * 3.33 * 3.0) / 32.0,
        ]
    )


@pytest.mark.parametrize("phase", LEVELS)
def test_it_rests_at_the_published_levels(phase):
    plant = QuadrupleTank(1.0, phase=phase)
    np.testing.assert_allclose(plant.initial_mean, LEVELS[phase], atol=6e-4)
    moved = plant.transition(plant.initial_mean[None])[0]
    np.testing.assert_allclose(moved, plant.initial_mean, rtol=1e-14)


def test_a_period_equals_the_solution_of_the_differential_equation():
    plant = QuadrupleTank(1.0)
    for start in ([12.0, 13.0, 1.6, 1.4], [1.0, 20.0, 5.0, 0.5]):
        exact = solve_ivp(rates, (0.0, 1.0), start, rtol=1e-11, atol=1e-12).y[:, -1]
        np.testing.assert_allclose(plant.transition(np.array([start]))[0], exact, rtol=1e-6)


def test_its_jacobian_is_the_derivative_of_its_transition():
    plant = QuadrupleTank(5.0, phase="non_minimum")
    state, h = np.array([12.0, 3.0, 4.0, 2.0]), 1e-5
    steps = h * np.eye(4)
    numeric = (plant.transition(state + steps) - plant.transition(state - steps)).T / (2.0 * h)
    np.testing.assert_allclose(plant.jacobian(state), numeric, atol=1e-9)


def test_an_empty_tank_stays_finite_and_fills():
    plant = QuadrupleTank(1.0)
    empty = np.array([0.0, -0.5, 0.0, 0.0])
    assert np.all(plant.transition(empty[None])[0] > empty)
    assert np.isfinite(plant.jacobian(empty)).all()


def test_other_voltages_have_another_equilibrium():
    plant = QuadrupleTank(1.0, voltages=[4.0, 3.0])
    assert plant.initial_mean[0] > LEVELS["minimum"][0]
    np.testing.assert_allclose(plant.transition(plant.initial_mean[None])[0], plant.initial_mean, rtol=1e-14)


@pytest.mark.parametrize(
    "plant",
    [
        QuadrupleTank(1.0, process_noise=Gaussian(std=[0.1, 0.2, 0.3, 0.4])),
        Linear(
            0.1,
            A=[[1.0, 0.1], [0.0, 0.9]],
            process_noise=Gaussian(covariance=[[0.2, 0.1], [0.1, 0.3]]),
            initial=Gaussian(std=[1.0, 2.0], mean=[5.0, -1.0]),
        ),
    ],
    ids=["quadruple_tank", "linear"],
)
def test_many_samples_have_the_law_of_one_step(plant):
    assert isinstance(plant, NonlinearPlant)
    assert isinstance(plant, SampledPlant)
    rng, draws, n = np.random.default_rng(1), 4000, len(plant.initial_mean)
    start = np.tile(plant.initial_mean, (draws, 1))
    initial = (plant.sample_initial(draws, rng), plant.initial_mean, plant.initial_covariance)
    moved = (plant.sample(start, rng), plant.transition(start[:1])[0], plant.Q)
    one_by_one = np.array([plant.advance(1, plant.initial_mean, rng) for _ in range(draws)])
    for samples, mean, covariance in (initial, moved, (one_by_one, *moved[1:])):
        white = np.linalg.solve(np.linalg.cholesky(covariance), (samples - mean).T)
        low, high = chi2.interval(1.0 - FALSE_ALARM, df=n * draws)
        assert low < np.sum(white**2) < high
        assert draws * np.sum(white.mean(axis=1) ** 2) < chi2.isf(FALSE_ALARM, df=n)


def test_many_states_move_as_each_of_them_does():
    plant, number = QuadrupleTank(1.0), 5000
    states = plant.sample_initial(number, np.random.default_rng(0))
    moved = plant.transition(states)
    for index in (0, 1, 2047, 2048, number - 1):
        np.testing.assert_allclose(moved[index], plant.transition(states[[index]])[0], rtol=1e-14)


def test_sampling_leaves_the_states_it_was_given_alone():
    plant = QuadrupleTank(1.0)
    states = plant.sample_initial(10, np.random.default_rng(0))
    before = states.copy()
    plant.sample(states, np.random.default_rng(0))
    assert np.array_equal(states, before)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"voltages": [3.0]}, "two positive voltages"),
        ({"voltages": [3.0, -1.0]}, "two positive voltages"),
        (
            {"process_noise": Gaussian(std=1.0, mean=[1.0, 0.0, 0.0, 0.0])},
            "process_noise must have mean zero",
        ),
        ({"initial": Gaussian(std=1.0, mean=[1.0])}, "mean has 1 entries, expected 4"),
    ],
)
def test_parameters_that_do_not_fit_are_refused_with_the_cure(changes, message):
    with pytest.raises(ValueError, match=message):
        QuadrupleTank(1.0, **changes)


def test_a_period_that_is_not_positive_is_refused():
    with pytest.raises(ValueError, match="positive sampling period"):
        QuadrupleTank(0.0)
