"""What the hybrid Bernoulli filter refuses, by name and with the cure."""

from dataclasses import replace

import numpy as np
import pytest

from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.hybrid_bernoulli import HybridBernoulli
from nodes.estimators.packet_sets import FakeBox
from tests.nodes.estimators.attacked_world import attackable


def refused(world, match, *names, **parameters):
    with pytest.raises(ValueError, match=match):
        world.filter(*names, **parameters)


def test_a_direction_of_the_attack_that_nothing_shows_is_refused_by_name():
    world = attackable(2)
    refused(
        world, r"e1: \(H\)' S\^-1 H is singular: .* in the direction \[-?0.0, -?1.0\]; add a sensor", "s1"
    )
    world.filter("s1", "s2")
    world.filter("s1", feedthrough=False)


def test_the_form_with_feedthrough_refuses_sensors_that_the_attack_does_not_reach():
    world = attackable()
    world.sensors["s1"].H = None
    refused(world, "e1: H is zero: .*; set 'feedthrough: false'", "s1")
    world.filter("s1", feedthrough=False)
    world.plant.G = np.zeros((2, 0))
    refused(world, "e1: C G is zero: .*; let G reach what is measured", "s1", feedthrough=False)


def test_parameters_that_make_no_sense_together_are_refused():
    world = attackable()
    refused(world, "needs a 'mean'", attack_prior=[AttackLaw(std=1.0)])
    refused(
        world,
        "all of one length",
        attack_prior=[AttackLaw([1.0], mean=[1.0]), AttackLaw(1.0, mean=[1.0, 2.0])],
    )
    refused(
        world, "singular; give every component a positive std", attack_prior=[AttackLaw(std=0.0, mean=[1.0])]
    )
    refused(world, "must be positive", attack_prior=[AttackLaw(std=1.0, mean=[1.0], weight=0.0)])
    refused(world, "give 'low' below 'high'", fakes=FakeBox(1.0, 1.0))
    refused(world, "a sensor 2; give one number", fakes=FakeBox([0.0] * 3, 1.0))
    refused(world, "G of Linear has the shape", attack_prior=[AttackLaw(std=1.0, mean=[1.0, 1.0, 1.0])])


def test_models_that_are_not_linear_need_other_moments(not_linear):
    setting = attackable().setting("s1")
    parameters = {
        "attack_prior": [AttackLaw(mean=[1.0], std=1.0)],
        "fakes": FakeBox(-1.0, 1.0),
        "attack_birth": 0.1,
        "attack_survival": 0.9,
    }
    with pytest.raises(ValueError, match="e1: plant SimpleNamespace is not linear; use a linear plant, or"):
        HybridBernoulli(replace(setting, plant=not_linear.plant), **parameters)
    with pytest.raises(ValueError, match=r"sensor s9 .* has no model that this method knows"):
        HybridBernoulli(replace(setting, sensors={"s9": not_linear.sensor}), **parameters)
