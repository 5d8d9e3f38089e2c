"""The nonlinear model that a run was made with, and what its bound expects of it."""

from __future__ import annotations

import numpy as np

from bus.plan import Plan
from bus.random_streams import random_stream
from orchestrator.evidence.models import UnsuitedError, built, kept, kind_name
from orchestrator.evidence.nonlinear_bound import DRAWS, Expectations, expectations
from orchestrator.score.gather import Floats


def nonlinear_expectations(plan: Plan) -> Expectations:
    """Return what the bound expects of a run's models.

    Raises `UnsuitedError` unless the plant has additive Gaussian noise, nothing commands it, every sensor has
    Gaussian noise, and the expectations are well known.
    """
    if plan.controllers:
        raise UnsuitedError("a controller drives a plant that is not linear and Gaussian")
    return kept(f"nonlinear, {plan.steps} steps", plan, lambda: _expectations(plan))


def _expectations(plan: Plan) -> Expectations:
    from nodes.plants.additive import Additive
    from nodes.plants.quadruple_tank import QuadrupleTank
    from nodes.sensors.gaussian_noise import GaussianNoise

    plant = built("plants", plan.plant.kind, plan.period_s)
    if not isinstance(plant, Additive):
        raise UnsuitedError(f"the plant {kind_name(plan.plant.kind)} has no additive Gaussian noise")
    sensors = []
    for own in plan.sensors:
        sensor = built("sensors", own.kind, plant)
        measure = getattr(sensor, "measure", None)
        if not isinstance(sensor, GaussianNoise) or measure is None or hasattr(sensor, "sends_innovations"):
            raise UnsuitedError(f"the sensor {own.name} ({kind_name(own.kind)}) is not Gaussian")
        sensors.append((measure, sensor.R))
    rng = random_stream(0, 0, plan.plant.name, "bound")
    states = plant.sample_initial(DRAWS, rng)
    steps: list[Floats] = []
    for k in range(plan.steps):
        states = plant.sample(states, rng) if k else states
        steps.append(np.ascontiguousarray(states))
    trajectories = np.stack(steps, axis=1)
    if isinstance(plant, QuadrupleTank) and trajectories.min() <= 0.0:
        raise UnsuitedError("a tank may run empty, where its model has a kink")
    return expectations(plant.transition, plant.Q, plant.initial_covariance, sensors, trajectories)
