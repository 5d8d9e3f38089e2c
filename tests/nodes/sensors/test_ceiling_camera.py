import numpy as np
import pytest
from scipy.stats import chi2

from bus.packets import Packet
from nodes.contract import LikelihoodSensor, NonlinearSensor, Setting
from nodes.estimators.extended_kalman import ExtendedKalman
from nodes.gaussian import Gaussian
from nodes.plants.planar_robot import PlanarRobot
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.remainders import BoundedSensor, SensorBank, bank_of, drawn_within
from nodes.sensors.ceiling_camera import CameraBank, CeilingCamera

FALSE_ALARM = 1e-6
PLANT = PlanarRobot(1.0)
PLACES = [[0.6, 0.6], [0.6, 1.8], [2.4, 1.2]]


def cameras(**more):
    return [CeilingCamera(PLANT, position=place, noise=Gaussian(std=1.0), **more) for place in PLACES]


def test_it_sees_what_the_published_equations_say():
    """Zhou 2020, (39) and (40), written out, less the centre of the picture."""
    x, y, heading = 1.5, 0.2, 0.4
    (camera, *_), (cx, cy) = cameras(), PLACES[0]
    along_u = -(cx - x) * np.sin(heading) + (cy - y) * np.cos(heading) - 0.0536
    along_v = -(cx - x) * np.cos(heading) - (cy - y) * np.sin(heading) + 0.0668
    expected = [9.0213283 / 2.105 * along_u, 9.0250141 / 2.105 * along_v]
    np.testing.assert_allclose(camera.measure(np.array([[x, y, heading]]))[0], expected, rtol=1e-14)


def test_its_jacobian_is_the_derivative_of_what_it_sees():
    camera, state, h = cameras()[1], np.array([1.2, 0.3, -1.9]), 1e-6
    steps = h * np.eye(3)
    numeric = (camera.measure(state + steps) - camera.measure(state - steps)).T / (2.0 * h)
    np.testing.assert_allclose(camera.jacobian(state), numeric, atol=1e-7)
    assert isinstance(camera, NonlinearSensor)
    assert isinstance(camera, LikelihoodSensor)


@pytest.mark.parametrize("spread", [0.05, 0.5, 3.0, 20.0])
def test_the_remainder_of_its_linearisation_stays_below_the_bound(spread):
    rng, state = np.random.default_rng(2), np.array([1.0, 2.0, 0.7])
    root = np.array([[0.4, 0.1, 0.0], [0.0, 0.2, 0.0], [0.3, 0.0, spread]])
    covariance = root.T @ root
    errors = np.array([drawn_within(1.0, 3, rng) for _ in range(4000)]) @ root
    for camera in cameras():
        assert isinstance(camera, BoundedSensor)
        left = (
            camera.measure(state + errors) - camera.measure(state[None]) - errors @ camera.jacobian(state).T
        )
        bound = camera.remainder_bound(state, covariance) * np.abs(errors[:, 2])
        assert np.all(np.linalg.norm(left, axis=1) <= bound + 1e-12)


def test_several_cameras_at_once_are_linearised_as_one_after_the_other():
    sensors, rng = cameras(), np.random.default_rng(3)
    roots = rng.normal(size=(2, 3, 3))
    states, covariances = rng.normal(size=(2, 3)), roots @ roots.swapaxes(1, 2)
    bank = bank_of(sensors)
    assert isinstance(bank, CameraBank)
    one, other = (each.linearised((2, 0), states, covariances) for each in (bank, SensorBank(sensors)))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


def test_an_extended_kalman_filter_on_cameras_is_as_good_as_it_claims():
    runs, steps, nees = 150, 10, 0.0
    plant = PlanarRobot(1.0, initial=Gaussian(std=0.05, mean=[1.5, 0.2, 0.0]))
    sensors = {
        f"s{i}": CeilingCamera(plant, position=place, noise=Gaussian(std=0.2))
        for i, place in enumerate(PLACES)
    }
    for seed in range(runs):
        rng, other = (
            np.random.default_rng(seed),
            ExtendedKalman(Setting("e1", plant, sensors, {}, np.random.default_rng(0))),
        )
        state = plant.initial_state(rng)
        for step in range(steps):
            state = plant.advance(step, state, rng) if step else state
            other.correct(
                step,
                [
                    Packet(name, step, step, "measurement", s.observe(step, state, rng))
                    for name, s in sensors.items()
                ],
            )
        belief = other.estimate(steps - 1)
        nees += float((belief.state - state) @ np.linalg.solve(belief.covariance, belief.state - state))
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=3 * runs)
    assert low < nees < high


def test_bounded_noise_is_never_longer_than_its_bound():
    camera, rng, state = cameras(noise_bound=1.4)[0], np.random.default_rng(0), np.zeros(3)
    noise = [camera.observe(0, state, rng) - camera.measure(state[None])[0] for _ in range(300)]
    assert np.linalg.norm(noise, axis=1).max() == pytest.approx(1.4)


def test_what_it_cannot_see_or_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="use the plant 'planar_robot'"):
        CeilingCamera(QuadrupleTank(1.0), position=[0.0, 0.0], noise=Gaussian(std=1.0))
    with pytest.raises(ValueError, match="position has 3 entries; give two"):
        CeilingCamera(PLANT, position=[0.0, 0.0, 1.0], noise=Gaussian(std=1.0))
