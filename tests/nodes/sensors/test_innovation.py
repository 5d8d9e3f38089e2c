from types import SimpleNamespace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from nodes.contract import LinearSensor
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.sensors.innovation import Innovation
from nodes.sensors.linear import Linear

MODEL = {"C": [[1.0, 0.5]], "noise": Gaussian(std=0.3)}


def plant(**changes):
    parameters = {
        "A": [[0.95, 0.2], [-0.2, 0.95]],
        "process_noise": Gaussian(std=0.1),
        "initial": Gaussian(std=1.0, mean=[3.0, -1.0]),
    }
    return LinearPlant(1.0, **(parameters | changes))


@pytest.mark.parametrize("gains", ["time_varying", "steady"])
def test_it_sends_the_innovations_of_another_librarys_filter_on_its_measurements(gains):
    world = plant()
    sensor, measuring = Innovation(world, gains=gains, **MODEL), Linear(world, **MODEL)
    assert isinstance(sensor, LinearSensor)
    kf = KalmanFilter(dim_x=2, dim_z=1)
    kf.F, kf.Q, kf.H, kf.R = world.A, world.Q, sensor.C, sensor.R
    kf.x, kf.P = world.initial_mean.copy(), world.initial_covariance.copy()
    if gains == "steady":
        for _ in range(300):
            kf.update(np.zeros(1))
            kf.predict()
        kf.x, settled = world.initial_mean.copy(), kf.P.copy()
    rngs = [np.random.default_rng(1) for _ in range(2)]
    driving, state = np.random.default_rng(2), world.initial_state(np.random.default_rng(3))
    for step in range(30):
        if step > 0:
            state = world.advance(step, state, driving)
            kf.predict()
        if gains == "steady":
            kf.P = settled
        sent = sensor.observe(step, state, rngs[0])
        kf.update(measuring.observe(step, state, rngs[1]))
        np.testing.assert_allclose(sent, kf.y, rtol=1e-9, atol=1e-9)


def test_its_noise_draws_are_those_of_a_linear_sensor():
    one, other = np.random.default_rng(0), np.random.default_rng(0)
    Innovation(plant(), **MODEL).observe(0, np.zeros(2), one)
    Linear(plant(), **MODEL).observe(0, np.zeros(2), other)
    assert one.bit_generator.state == other.bit_generator.state


def test_a_signal_attack_enters_what_it_measures():
    clean = Innovation(plant(), **MODEL)
    attacked = Innovation(plant(), H=[[2.0]], **MODEL)
    without = clean.observe(0, np.zeros(2), np.random.default_rng(0))
    value = attacked.observe(0, np.zeros(2), np.random.default_rng(0), attack=np.array([5.0]))
    np.testing.assert_allclose(value - without, [10.0])


def test_a_plant_with_an_input_or_without_matrices_is_refused():
    with pytest.raises(ValueError, match="needs a linear plant without input; take a linear sensor"):
        Innovation(plant(B=[[0.0], [1.0]]), **MODEL)
    with pytest.raises(ValueError, match="needs a linear plant without input; take a linear sensor"):
        Innovation(SimpleNamespace(initial_mean=np.zeros(2)), **MODEL)
