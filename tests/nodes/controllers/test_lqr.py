from types import SimpleNamespace

import numpy as np
import pytest

from nodes.contract import ControllerSetting
from nodes.controllers.lqr import Lqr
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear


def setting(A=((1.1, 0.1), (0.0, 1.0)), B=((0.0,), (0.5,))):
    plant = Linear(
        1.0,
        A=[list(row) for row in A],
        B=[list(row) for row in B],
        process_noise=Gaussian(std=0.0),
        initial=Gaussian(std=0.0),
    )
    return ControllerSetting("c1", plant, np.random.default_rng(0))


def test_its_gain_is_the_limit_of_the_backward_recursion_of_finite_horizons():
    given = setting()
    A, B = given.plant.A, given.plant.B
    V, U = np.array([[2.0, 0.3], [0.3, 1.0]]), np.array([[0.4]])
    cost, gain = V, np.zeros((1, 2))
    for _ in range(500):
        gain = np.linalg.solve(U + B.T @ cost @ B, B.T @ cost @ A)
        cost = V + A.T @ cost @ (A - B @ gain)
    lqr = Lqr(given, state_weight=V.tolist(), input_weight=U.tolist())
    np.testing.assert_allclose(lqr.gain, gain, rtol=1e-9)


def test_the_loop_is_stable_although_the_plant_is_not():
    given = setting()
    lqr = Lqr(given, state_weight=[1.0, 0.0], input_weight=[1.0])
    assert np.abs(np.linalg.eigvals(given.plant.A)).max() > 1.0
    assert np.abs(np.linalg.eigvals(given.plant.A - given.plant.B @ lqr.gain)).max() < 1.0


def test_diagonals_and_matrices_are_the_same_weights():
    one = Lqr(setting(), state_weight=[1.0, 2.0], input_weight=[3.0])
    other = Lqr(setting(), state_weight=[[1.0, 0.0], [0.0, 2.0]], input_weight=[[3.0]])
    np.testing.assert_array_equal(one.gain, other.gain)


def test_reference_and_watermark_are_those_of_state_feedback():
    lqr = Lqr(setting(), state_weight=[1.0, 1.0], input_weight=[1.0], reference=[1.0, 2.0])
    np.testing.assert_array_equal(lqr.control(0, np.array([1.0, 2.0])), [0.0])
    marked = Lqr(setting(), state_weight=[1.0, 1.0], input_weight=[1.0], watermark=Gaussian(std=1.0))
    assert marked.control(0, None) != 0.0


@pytest.mark.parametrize(
    ("A", "state_weight"),
    [
        (((1.2, 0.0), (0.0, 0.5)), [1.0, 1.0]),  # the unstable mode is not reached
        (((1.0, 0.0), (0.0, 0.5)), [1.0, 1.0]),
        (((0.5, 0.0), (0.0, 1.0)), [1.0, 0.0]),  # the mode that does not decay costs nothing
    ],
)
def test_a_plant_that_no_gain_stabilises_is_refused_with_the_cure(A, state_weight):
    with pytest.raises(ValueError, match="no gain of these weights stabilises the plant; give it inputs"):
        Lqr(setting(A=A), state_weight=state_weight, input_weight=[1.0])


@pytest.mark.parametrize(
    ("state_weight", "input_weight", "message"),
    [
        ([1.0], [1.0], "state_weight must be 2 numbers, or a symmetric matrix of 2 rows"),
        ([[1.0, 2.0], [0.0, 1.0]], [1.0], "state_weight must be 2 numbers, or a symmetric matrix"),
        ([1.0, -1.0], [1.0], "state_weight must be positive semidefinite"),
        ([1.0, 1.0], [0.0], "input_weight must be positive definite"),
    ],
)
def test_weights_that_do_not_fit_are_refused_with_the_cure(state_weight, input_weight, message):
    with pytest.raises(ValueError, match=message):
        Lqr(setting(), state_weight=state_weight, input_weight=input_weight)


def test_a_plant_that_is_not_linear_is_refused():
    plant = SimpleNamespace(B=np.ones((2, 1)), initial_mean=np.zeros(2))
    with pytest.raises(ValueError, match="the plant is not linear; give a gain with 'state_feedback'"):
        Lqr(ControllerSetting("c1", plant, np.random.default_rng(0)), state_weight=[1.0], input_weight=[1.0])
