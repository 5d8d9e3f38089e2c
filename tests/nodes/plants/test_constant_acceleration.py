import numpy as np
import pytest

from nodes.contract import LinearPlant
from nodes.gaussian import Gaussian
from nodes.plants.constant_acceleration import ConstantAcceleration


def test_without_noise_it_falls_as_a_stone_does():
    plant = ConstantAcceleration(0.05, process_noise=Gaussian(std=0.0), initial=Gaussian(std=1.0))
    rng, state = np.random.default_rng(0), np.array([3.0, 2.0, -9.81])
    for step in range(1, 41):
        state = plant.advance(step, state, rng)
    np.testing.assert_allclose(
        state, [3.0 + 2.0 * 2.0 - 0.5 * 9.81 * 4.0, 2.0 - 9.81 * 2.0, -9.81], rtol=1e-13
    )


def test_its_components_are_the_groups_of_the_score():
    plant = ConstantAcceleration(0.05, process_noise=Gaussian(std=0.2), initial=Gaussian(std=1.0))
    assert isinstance(plant, LinearPlant)
    assert plant.state_groups == {"position": [0], "velocity": [1], "acceleration": [2]}


def test_laws_of_another_size_are_refused():
    with pytest.raises(ValueError, match="expected 1 or 3"):
        ConstantAcceleration(0.05, process_noise=Gaussian(std=[0.2, 0.2]), initial=Gaussian(std=1.0))
