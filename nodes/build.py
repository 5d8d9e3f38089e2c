"""From a plan to node objects and their programs. Each node draws from random streams of its own name."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bus.kinds import load_class
from bus.plan import ControllerPlan, EstimatorPlan, Plan
from bus.program import Port, Program
from bus.random_streams import random_stream
from nodes.contract import Controller, ControllerSetting, Estimator, Plant, Sensor, Setting
from nodes.estimator_program import estimator_program
from nodes.programs import controller_program, plant_program, sensor_program


def build_plant(plan: Plan) -> Plant:
    """Construct the plant's model."""
    plant: Plant = load_class(plan.plant.kind.reference)(plan.period_s, **plan.plant.kind.parameters)
    return plant


def build_sensor(plan: Plan, name: str, plant: Plant) -> Sensor:
    """Construct the model of one sensor."""
    (own,) = (sensor for sensor in plan.sensors if sensor.name == name)
    sensor: Sensor = load_class(own.kind.reference)(plant, **own.kind.parameters)
    return sensor


def build_estimator(plan: Plan, own: EstimatorPlan, plant: Plant, sensors: Mapping[str, Sensor]) -> Estimator:
    """Construct an estimator, told of the plant, of the sensors it listens to and of its neighbours."""
    kind = load_class(own.kind.reference)
    setting = Setting(
        name=own.name,
        plant=plant,
        sensors={name: sensors[name] for name in own.sensors},
        neighbours=dict(own.neighbours),
        rng=random_stream(plan.seed, plan.trial, own.name, "estimator"),
        neighbour_sensors=_sensors_of_neighbours(plan, own, plant) if asks_for_sensors(kind) else {},
    )
    estimator: Estimator = kind(setting, **own.kind.parameters)
    return estimator


def asks_for_sensors(kind: type) -> bool:
    """Return whether a kind of estimator asks for the models of its neighbours' sensors."""
    return bool(getattr(kind, "knows_neighbours_sensors", False))


def _sensors_of_neighbours(plan: Plan, own: EstimatorPlan, plant: Plant) -> dict[str, dict[str, Sensor]]:
    """Construct the models of the sensors that each neighbour listens to."""
    return {
        other.name: {name: build_sensor(plan, name, plant) for name in other.sensors}
        for other in plan.estimators
        if other.name in own.neighbours
    }


def build_controller(plan: Plan, own: ControllerPlan, plant: Plant) -> Controller:
    """Construct a controller, told of the plant."""
    rng = random_stream(plan.seed, plan.trial, own.name, "controller")
    setting = ControllerSetting(own.name, plant, rng)
    controller: Controller = load_class(own.kind.reference)(setting, **own.kind.parameters)
    return controller


def node_program(port: Port, plan: Plan, name: str, window: int) -> Program:
    """Return the program of the named node; it receives the topics that `bus.grants.inputs` names."""

    def stream(purpose: str) -> np.random.Generator:
        return random_stream(plan.seed, plan.trial, name, purpose)

    plant = build_plant(plan)
    if name == plan.plant.name:
        return plant_program(port, plan, plant, window, stream("initial_state"), stream("process_noise"))
    if any(sensor.name == name for sensor in plan.sensors):
        return sensor_program(port, plan, name, build_sensor(plan, name, plant), stream("measurement_noise"))
    for commanding in plan.controllers:
        if commanding.name == name:
            return controller_program(port, plan, commanding, build_controller(plan, commanding, plant))
    (own,) = (estimator for estimator in plan.estimators if estimator.name == name)
    sensors = {heard: build_sensor(plan, heard, plant) for heard in own.sensors}
    estimator = build_estimator(plan, own, plant, sensors)
    return estimator_program(port, plan, own, estimator, plant.initial_mean.size, window)
