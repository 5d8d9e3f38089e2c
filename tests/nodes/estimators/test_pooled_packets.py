"""Filters that take every packet for a measurement: many of one sensor count as one of many alike sensors."""

import numpy as np
import pytest

from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.imm import Imm
from nodes.estimators.jise import Jise
from nodes.estimators.packet_sets import pooled
from tests.nodes.estimators.attacked_world import Attackable, attackable, packet

PRIOR = AttackLaw(mean=[2.0], std=1.5)
MAKE = {
    "imm": lambda setting, **more: Imm(
        setting, attack_prior=PRIOR, attack_birth=0.3, attack_survival=0.6, **more
    ),
    "jise": lambda setting, **more: Jise(setting, attack_prior=PRIOR, **more),
}


@pytest.mark.parametrize("feedthrough", [True, False])
@pytest.mark.parametrize("method", MAKE)
def test_packets_of_one_sensor_say_what_those_of_alike_sensors_say_one_by_one(method, feedthrough):
    world, rng = attackable(), np.random.default_rng(3)
    if not feedthrough:
        world.sensors["s1"].H = None
    alike = Attackable(world.plant, {f"t{i}": world.sensors["s1"] for i in range(4)}, world.prior)
    together = MAKE[method](world.setting("s1"), feedthrough=feedthrough)
    one_by_one = MAKE[method](alike.setting(), feedthrough=feedthrough)
    for step in range(12):
        values = rng.normal(0.0, 2.0, (rng.integers(0, 5), 2))
        together.correct(step, [packet(step, "s1", own) for own in values])
        one_by_one.correct(step, [packet(step, f"t{i}", own) for i, own in enumerate(values)])
        told, expected = together.estimate(step), one_by_one.estimate(step)
        np.testing.assert_allclose(told.state, expected.state, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(told.covariance, expected.covariance, rtol=1e-9, atol=1e-9)
        assert told.diagnostics == pytest.approx(expected.diagnostics, rel=1e-9, abs=1e-9)
        assert told.nis_dof == expected.nis_dof
        if method == "jise":  # that of `imm` is the likelier mode's, which may change from packet to packet
            assert told.nis == pytest.approx(expected.nis, rel=1e-9, abs=1e-9)


def test_the_likelihood_of_all_is_that_of_the_mean_and_of_the_scatter():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3))
    noise, h, values = root @ root.T, rng.normal(size=3), rng.normal(size=(5, 3))
    found = pooled([packet(0, "s1", own) for own in values], noise)
    of_all = sum((own - h) @ np.linalg.inv(noise) @ (own - h) for own in values)
    of_mean = (found.values - h) @ np.linalg.inv(found.noise) @ (found.values - h)
    assert of_mean + found.scatter == pytest.approx(of_all, rel=1e-12)
    assert found.scatter_dof + 3 == values.size
