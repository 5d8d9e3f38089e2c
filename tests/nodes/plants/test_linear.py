import numpy as np
import pytest
from scipy.stats import chi2

from nodes.contract import LinearPlant
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear

FALSE_ALARM = 1e-6


def plant(**changes):
    parameters = {
        "A": [[1.0, 0.1], [0.0, 0.9]],
        "process_noise": Gaussian(covariance=[[0.2, 0.1], [0.1, 0.3]]),
        "initial": Gaussian(std=[1.0, 2.0], mean=[5.0, -1.0]),
    }
    return Linear(0.1, **{**parameters, **changes})


def test_it_is_a_linear_plant_with_the_matrices_it_was_given():
    model = plant()
    assert isinstance(model, LinearPlant)
    np.testing.assert_array_equal(model.A, [[1.0, 0.1], [0.0, 0.9]])
    np.testing.assert_array_equal(model.Q, [[0.2, 0.1], [0.1, 0.3]])
    np.testing.assert_array_equal(model.initial_mean, [5.0, -1.0])
    np.testing.assert_array_equal(model.initial_covariance, [[1.0, 0.0], [0.0, 4.0]])


def test_without_groups_the_whole_state_is_one():
    assert plant().state_groups == {"state": [0, 1]}
    assert plant(state_groups={"second": [1]}).state_groups == {"second": [1]}


def test_without_noise_it_moves_by_its_dynamics_alone():
    model = plant(process_noise=Gaussian(std=0.0))
    state = model.advance(1, np.array([1.0, 2.0]), np.random.default_rng(0))
    np.testing.assert_allclose(state, [1.2, 1.8], rtol=1e-15)


@pytest.mark.parametrize("law", ["initial", "process noise"])
def test_its_draws_have_the_mean_and_covariance_that_were_asked_for(law):
    model, rng, draws = plant(), np.random.default_rng(1), 4000
    if law == "initial":
        mean, covariance = model.initial_mean, model.initial_covariance
        samples = [model.initial_state(rng) for _ in range(draws)]
    else:
        mean, covariance = model.A @ [1.0, 1.0], model.Q
        samples = [model.advance(1, np.ones(2), rng) for _ in range(draws)]
    white = np.linalg.solve(np.linalg.cholesky(covariance), (np.array(samples) - mean).T)
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=2 * draws)
    assert low < np.sum(white**2) < high
    assert draws * np.sum(white.mean(axis=1) ** 2) < chi2.isf(FALSE_ALARM, df=2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"A": [[1.0, 0.0]]}, "square"),
        ({"A": []}, "square"),
        ({"A": [[1.0, 0.0], [1.0]]}, "square"),
        ({"process_noise": Gaussian(std=[1.0])}, "std has 1 entries, expected 1 or 2"),
        ({"process_noise": Gaussian(std=1.0, mean=[1.0, 0.0])}, "process_noise must have mean zero"),
        ({"initial": Gaussian(std=1.0, mean=[1.0])}, "mean has 1 entries, expected 2"),
        ({"state_groups": {"third": [2]}}, "'third' is \\[2\\]; give indices from 0 to 1"),
        ({"state_groups": {"none": []}}, "'none'"),
    ],
)
def test_parameters_that_do_not_fit_are_refused_with_the_cure(changes, message):
    with pytest.raises(ValueError, match=message):
        plant(**changes)


def test_a_period_that_is_not_positive_is_refused():
    with pytest.raises(ValueError, match="positive sampling period"):
        Linear(0.0, A=[[1.0]], process_noise=Gaussian(std=1.0), initial=Gaussian(std=1.0))
