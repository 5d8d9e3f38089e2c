"""The gains in closed form, held to the sums that define them and to what they claim."""

from __future__ import annotations

import numpy as np
import pytest

from nodes.estimators.event_triggered_extended_kalman import GainDesign
from nodes.estimators.gain_knowledge import Deception, Shares
from nodes.estimators.gain_riccati import (
    Riccati,
    best_gains,
    nominal,
    residual,
    second_moments,
)
from tests.nodes.estimators.camera_network import ATTACK, cameras, locals_of

MEAN, VARIANCE = 0.8, 1.4**2 / 12.0
Q = np.diag([0.02, 0.02, 0.01]) ** 2
PAPER = Shares.of(ATTACK, 2)
WEAK = Shares.of(Deception(low=0.0, high=0.1, value=1.0, probability=0.2), 2)


@pytest.fixture(scope="module")
def known():
    """What eight nodes knew in six steps."""
    return locals_of(cameras(), 6, 5.0)


def selections(members):
    d = members - 1
    own = np.vstack((np.eye(2), -d * np.eye(2)))
    return [own, *[np.vstack((np.zeros((2, 2)), np.eye(2)))] * d]


def test_the_groups_are_the_sums_that_define_them(known):
    for local in known[::7]:
        members = len(local.values)
        T = selections(members)
        P, H, h = local.covariances, local.slopes, local.values
        V, D, eta = local.remainders, local.differences, local.slack
        heading = P[:, 2, 2]
        slope = sum(T[j] @ H[j] for j in range(members)) * (1.0 - MEAN)
        known_mean = sum(T[j] @ ((1.0 - MEAN) * H[j] @ D[j] - MEAN * h[j]) for j in range(members))
        noise = [
            ((1.0 - MEAN) ** 2 + VARIANCE) * np.eye(2)
            + 3.0
            * VARIANCE
            * np.diag(np.diag(H[j] @ P[j] @ H[j].T) + V[j] ** 2 * heading[j] + (np.abs(h[j]) + 6.0) ** 2)
            for j in range(members)
        ]
        expected = {
            "slope": slope,
            "known": np.outer(known_mean, known_mean),
            "remainder": members
            * (1.0 - MEAN) ** 2
            * sum(V[j] ** 2 * heading[j] * T[j] @ T[j].T for j in range(members)),
            "value": 2.0 * members * MEAN**2 * 36.0 * sum(t @ t.T for t in T),
            "trigger": members * sum(eta[j] * T[j] @ T[j].T for j in range(members)),
            "noise": sum(T[j] @ noise[j] @ T[j].T for j in range(members)),
            "drift": local.remainder**2 * heading[0] * np.diag([1.0, 1.0, 0.0]),
        }
        moments = second_moments(local, PAPER)
        names = ("known", "remainder", "value", "trigger", "noise")
        found = dict(zip(names, moments.groups(local), strict=True))
        found |= {"slope": moments.slope, "drift": moments.drift}
        for name, value in expected.items():
            np.testing.assert_allclose(found[name], value, rtol=1e-10, atol=1e-10, err_msg=name)
        slope, together = nominal(local, PAPER)
        np.testing.assert_array_equal(slope, moments.slope)
        np.testing.assert_allclose(together, sum(moments.groups(local)), rtol=1e-10)


def test_no_other_gains_have_a_smaller_bound(known):
    rng = np.random.default_rng(0)
    for local in known[5::9]:
        for slope, S in (nominal(local, PAPER), residual(local, PAPER)):
            P = local.covariances[0]
            found = best_gains(local, slope, S, Q)

            def bound(gains, slope=slope, S=S, P=P, F=local.F):
                closed = F - gains @ slope
                return Q + closed @ P @ closed.T + gains @ S @ gains.T

            np.testing.assert_allclose(found.bound, bound(found.matrix), rtol=1e-8, atol=1e-12)
            for _ in range(5):
                other = found.matrix + 1e-2 * rng.normal(size=found.matrix.shape)
                assert np.linalg.eigvalsh(bound(other) - found.bound)[0] > -1e-10


def test_with_the_papers_numbers_the_guaranteed_gains_are_none_at_all(known):
    for local in known[::5]:
        found = Riccati(PAPER, Q, variant="adversarial").gains(local)
        assert not found.matrix.any()
        assert np.linalg.eigvalsh(found.bound - local.F @ local.covariances[0] @ local.F.T)[0] > 0.0


def test_against_a_weak_attack_the_guaranteed_gains_are_active_and_bound_every_correlation():
    """Each group is drawn as far as its second moment allows, all in one direction of the error."""
    rng = np.random.default_rng(1)
    for local in locals_of(cameras(4, assumed_attack=None), 2, 0.0):
        shape = np.broadcast_to(np.diag([9.0, 9.0, 1e-4]), (4, 3, 3))
        wide = local._replace(covariances=shape, remainder=0.001, remainders=np.full(4, 13.0))
        found = Riccati(WEAK, Q, variant="adversarial").gains(wide)
        moments = second_moments(wide, WEAK)
        assert found.matrix.any()
        assert np.trace(found.bound) < 0.5 * np.trace(wide.F @ wide.covariances[0] @ wide.F.T)
        closed = wide.F - found.matrix @ moments.slope
        blocks = [closed @ wide.covariances[0] @ closed.T, moments.drift]
        blocks += [found.matrix @ group @ found.matrix.T for group in moments.groups(wide)]
        for direction in rng.normal(size=(200, 3)):
            together = sum(np.sqrt(max(direction @ block @ direction, 0.0)) for block in blocks)
            bound = direction @ (found.bound - Q) @ direction
            assert together**2 <= bound * (1.0 + 1e-9)


def test_an_attack_that_is_not_assumed_changes_nothing_and_leaves_the_noise(known):
    shares = Shares.of(None, 2)
    local = known[9]._replace(remainders=np.zeros(8), slack=np.zeros(8))
    moments = second_moments(local, shares)
    np.testing.assert_allclose(moments.groups(local)[-1], sum(t @ t.T for t in selections(8)))
    assert not moments.value.any()
    assert not moments.trigger.any()


def test_shares_of_an_attack_that_may_rest_have_its_mean_and_variance():
    shares = Shares.of(Deception(low=[0.1, 0.2], high=[1.5, 0.4], value=1.0, probability=0.5), 2)
    rng = np.random.default_rng(0)
    drawn = rng.uniform([0.1, 0.2], [1.5, 0.4], (200_000, 2)) * (rng.random((200_000, 2)) < 0.5)
    np.testing.assert_allclose(shares.mean, drawn.mean(axis=0), atol=5e-3)
    np.testing.assert_allclose(shares.variance, drawn.var(axis=0), atol=5e-3)
    assert not shares.low.any()


def test_bounds_that_are_none_are_refused():
    with pytest.raises(ValueError, match="nor above 'high'"):
        Shares.of(Deception(low=0.5, high=0.1, value=1.0), 2)
    with pytest.raises(ValueError, match="one for each of 2 outputs"):
        Shares.of(Deception(low=[0.1, 0.1, 0.1], high=1.0, value=1.0), 2)


def test_a_guaranteed_filter_says_so_and_is_dead_reckoning():
    network = cameras(3, design=GainDesign(riccati="adversarial"))
    start = network.nodes[0]._state
    known = locals_of(network, 4, 5.0)
    assert known
    for _ in range(4):
        start = network.plant.transition(start[None])[0]
    belief = network.nodes[0].estimate(3)
    np.testing.assert_array_equal(belief.state, start)
    assert belief.diagnostics["bound_guaranteed"] == 1.0
