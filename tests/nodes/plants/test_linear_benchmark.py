import numpy as np
import pytest

from nodes.gaussian import Gaussian
from nodes.plants.linear_benchmark import LinearBenchmark


def test_under_the_papers_attack_it_settles_at_120_and_25():
    plant = LinearBenchmark(1.0, process_noise=Gaussian(std=0.0), truth=[0.0] * 5)
    rng = np.random.default_rng(0)
    state = plant.initial_state(rng)
    assert not state.any()
    for step in range(1, 100):
        state = plant.advance(step, state, rng, attack=np.array([10.0, 20.0]))
    np.testing.assert_allclose(state, [120.0, 25.0, 0.0, 0.0, 0.0], atol=1e-9)


def test_estimators_are_told_the_papers_guess_whatever_the_truth_is():
    plant = LinearBenchmark(1.0, truth=[0.0] * 5)
    np.testing.assert_array_equal(plant.initial_mean, [10.0, 10.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(plant.initial_covariance, 1e4 * np.eye(5))
    assert plant.state_groups == {"x1": [0], "x2": [1], "x3_to_x5": [2, 3, 4]}
    assert LinearBenchmark(1.0).initial_state(np.random.default_rng(0)).any()
    with pytest.raises(ValueError, match="truth has 2 entries; give 5"):
        LinearBenchmark(1.0, truth=[0.0, 0.0])
