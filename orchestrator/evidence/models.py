"""The models that a run was made with, rebuilt from its topology for those statistics that need them."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bus.plan import Kind, Plan
from orchestrator.registry import BUILT_IN, Role
from orchestrator.score.gather import Floats


class UnsuitedError(Exception):
    """A statistic would be wrong for this run; the text says why."""


@dataclass(frozen=True)
class LinearModel:
    """A linear Gaussian plant and its sensors, in the order of the plan.

    ``A``, ``Q`` and ``initial_covariance`` are (n, n); ``C`` and ``R`` hold (m, n) and (m, m) of each sensor.
    """

    A: Floats
    Q: Floats
    initial_covariance: Floats
    C: tuple[Floats, ...]
    R: tuple[Floats, ...]


def linear_model(plan: Plan) -> LinearModel:
    """Return the model of a run; raises `UnsuitedError` unless plant and sensors are linear and Gaussian.

    Nothing of a user's own code is loaded: a kind that is not registered here is not known to be Gaussian.
    """
    from nodes.plants.linear import Linear as LinearPlant
    from nodes.sensors.linear import Linear as LinearSensor

    plant = _built("plants", plan.plant.kind, plan.period_s)
    if not isinstance(plant, LinearPlant):
        raise UnsuitedError(f"the plant {_name(plan.plant.kind)} is not linear and Gaussian")
    sensors = []
    for own in plan.sensors:
        sensor = _built("sensors", own.kind, plant)
        if not isinstance(sensor, LinearSensor) or getattr(sensor, "sends_innovations", False):
            raise UnsuitedError(f"the sensor {own.name} ({_name(own.kind)}) is not linear and Gaussian")
        if np.linalg.eigvalsh(sensor.R)[0] <= 0.0:
            raise UnsuitedError(f"the sensor {own.name} has no noise in some direction")
        sensors.append(sensor)
    return LinearModel(
        plant.A,
        plant.Q,
        plant.initial_covariance,
        tuple(sensor.C for sensor in sensors),
        tuple(sensor.R for sensor in sensors),
    )


def registered_name(role: Role, kind: Kind) -> str | None:
    """Return by which name a kind is built in, None for any other."""
    if kind.reference in BUILT_IN[role]:
        return kind.reference
    return next((name for name, found in BUILT_IN[role].items() if found == kind.reference), None)


def _name(kind: Kind) -> str:
    return kind.reference.rpartition(":")[2]


def _built(role: Role, kind: Kind, first: Any) -> Any:
    """Return an object of a built-in kind; ``first`` is what its role fills in."""
    name = registered_name(role, kind)
    if name is None:
        raise UnsuitedError(f"the kind {_name(kind)} is a user's own, of which nothing is known here")
    return _class(role, name)(first, **_typed(role, name, kind.parameters))


def _typed(role: Role, name: str, parameters: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return parameters as a constructor takes them; a log's are plain, those of a ready plan are typed."""
    try:
        text = json.dumps(parameters)
    except TypeError:
        return parameters
    return _filled(role, name, text)


@functools.lru_cache(maxsize=256)
def _filled(role: Role, name: str, parameters: str) -> Mapping[str, Any]:
    from orchestrator.registry import find_kind
    from orchestrator.topology.parameters import fill, parameters_model, values

    model = parameters_model(find_kind(role, name, Path()), role)
    return values(fill(model, json.loads(parameters)))


def _class(role: Role, name: str) -> Any:
    from bus.kinds import load_class

    return load_class(BUILT_IN[role][name])
