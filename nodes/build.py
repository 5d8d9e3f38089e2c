"""From a plan to node objects and their programs. Each node draws from random streams of its own name."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bus.kinds import load_class
from bus.plan import ControllerPlan, EstimatorPlan, Plan, SensorPlan
from bus.program import Port, Program
from bus.random_streams import random_stream
from nodes.contract import Controller, ControllerSetting, Estimator, Plant, Sensor, Setting, Trigger
from nodes.estimator_program import estimator_program
from nodes.programs import controller_program, plant_program, sensor_program
from nodes.triggers.contract import TriggerSetting


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
        rng=random_stream(plan.seed, plan.trial, own.stream or own.name, "estimator"),
        told_attacks=bool(own.oracles),
        neighbour_sensors=_sensors_of_neighbours(plan, own, plant) if asks_for_sensors(kind) else {},
        trigger=build_trigger(plan, own, plant) if takes_trigger(own) else None,
        sensor_triggers={
            sensor.name: trigger
            for sensor in plan.sensors
            if sensor.name in sensors
            and (trigger := build_trigger(plan, sensor, plant, sensors[sensor.name], heard_by=own.name))
        },
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


def takes_trigger(own: EstimatorPlan) -> bool:
    """Return whether a method asks the node's event trigger itself."""
    return bool(getattr(load_class(own.kind.reference), "takes_trigger", False))


def build_trigger(
    plan: Plan,
    own: SensorPlan | EstimatorPlan,
    plant: Plant,
    sensor: Sensor | None = None,
    heard_by: str = "",
) -> Trigger | None:
    """Construct a node's event trigger, or the copy of it that who hears the node has; None without one."""
    if own.send is None:
        return None
    name, purpose = (heard_by, f"trigger/{own.name}") if heard_by else (own.name, "trigger")
    setting = TriggerSetting(own.name, plant, sensor, random_stream(plan.seed, plan.trial, name, purpose))
    trigger: Trigger = load_class(own.send.reference)(setting, **own.send.parameters)
    return trigger


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
        (sensing,) = (sensor for sensor in plan.sensors if sensor.name == name)
        sensor = build_sensor(plan, name, plant)
        trigger = build_trigger(plan, sensing, plant, sensor)
        return sensor_program(port, plan, name, sensor, stream("measurement_noise"), trigger)
    for commanding in plan.controllers:
        if commanding.name == name:
            return controller_program(port, plan, commanding, build_controller(plan, commanding, plant))
    (own,) = (estimator for estimator in plan.estimators if estimator.name == name)
    sensors = {heard: build_sensor(plan, heard, plant) for heard in own.sensors}
    estimator = build_estimator(plan, own, plant, sensors)
    trigger = None if takes_trigger(own) else build_trigger(plan, own, plant)
    return estimator_program(port, plan, own, estimator, plant.initial_mean.size, window, trigger)
