from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.jise import Jise
from tests.nodes.estimators.attacked_world import assert_chi_squared, attackable, claims, packet

PRIOR = AttackLaw(mean=[0.0], std=1.0)


def gillijns_de_moor(world, measurements, feedthrough):
    """Yield state and signal by the batch problem: least squares over all that happened so far.

    Both filters of 2007 minimise the same weighted sum of squares recursively, the signal unweighted.
    """
    plant, sensor = world.plant, world.sensors["s1"]
    n, q = 2, plant.G.shape[1]
    for steps in range(1, len(measurements) + 1):
        rows, values = [], []

        def add(matrix, value, covariance, rows=rows, values=values):
            factor = np.linalg.inv(np.linalg.cholesky(covariance))
            rows.append(factor @ matrix)
            values.append(factor @ value)

        size = steps * (n + q)
        state = [np.eye(size)[k * (n + q) : k * (n + q) + n] for k in range(steps)]
        signal = [np.eye(size)[k * (n + q) + n : (k + 1) * (n + q)] for k in range(steps)]
        add(state[0], plant.initial_mean, plant.initial_covariance)
        for k in range(steps):
            if k:
                add(state[k] - plant.A @ state[k - 1] - plant.G @ signal[k - 1], np.zeros(n), plant.Q)
            row = sensor.C @ state[k] + (sensor.H @ signal[k] if feedthrough else 0.0)
            add(row, measurements[k], sensor.R)
        solution = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=None)[0]
        yield state[-1] @ solution, signal[steps - 1 if feedthrough else steps - 2] @ solution


@pytest.mark.parametrize("feedthrough", [True, False])
def test_its_last_state_and_signal_are_the_least_squares_over_all_that_happened(feedthrough):
    """The recursion keeps only the last law, which loses nothing here."""
    world, rng = attackable(), np.random.default_rng(0)
    filter_ = Jise(world.setting("s1"), attack_prior=PRIOR, feedthrough=feedthrough)
    measured = list(rng.normal(0.0, 3.0, (8, 2)))
    for step, (x, a) in enumerate(gillijns_de_moor(world, measured, feedthrough)):
        filter_.correct(step, [packet(step, "s1", measured[step])])
        belief = filter_.estimate(step)
        np.testing.assert_allclose(belief.state, x, rtol=1e-8, atol=1e-8)
        if step or feedthrough:
            assert belief.diagnostics["a0"] == pytest.approx(a[0], abs=1e-8)


@pytest.mark.parametrize("feedthrough", [True, False])
def test_errors_are_as_large_as_it_claims_whatever_the_signal(feedthrough):
    """NEES at the end, NIS over all steps, 300 independent runs; limits left once in a million campaigns."""
    world = attackable()
    if not feedthrough:
        world.sensors["s1"].H = None
    jise = partial(Jise, world.setting("s1"), attack_prior=PRIOR, feedthrough=feedthrough)
    runs, steps = 300, 8
    found = claims(
        world,
        jise,
        lambda rng, seed, step: np.array([100.0 * np.sin(step + seed)]),
        runs=runs,
        steps=steps,
    )
    assert_chi_squared(found.nees, 2 * runs)
    assert found.nis_dof == runs * (steps if feedthrough else steps + 1)
    assert_chi_squared(found.nis, found.nis_dof)


def test_a_signal_that_no_packet_shows_is_taken_from_its_prior():
    world = attackable()
    filter_ = Jise(world.setting("s1"), attack_prior=replace(PRIOR, mean=[4.0]))
    filter_.correct(0, [])
    filter_.correct(1, [])
    belief = filter_.estimate(1)
    np.testing.assert_allclose(
        belief.state, world.plant.A @ world.plant.initial_mean + world.plant.G @ [4.0], rtol=1e-12
    )
    assert (belief.diagnostics["a0"], belief.diagnostics["a0_sigma"]) == (4.0, 1.0)
    assert (belief.nis, belief.nis_dof) == (0.0, 0)
    assert filter_.exchange(1, 0, []) is None


def test_a_signal_that_no_sensor_shows_is_refused():
    world = attackable()
    world.sensors["s1"].H = None
    with pytest.raises(ValueError, match="H is zero"):
        Jise(world.setting("s1"), attack_prior=PRIOR)
