"""What can be said of a topology before it runs: whether its filters' bounds can stay bounded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus import keys
from bus.plan import EstimatorPlan, Plan
from channel.impairments.gilbert_elliott import GilbertElliott
from nodes.build import build_plant, build_sensor
from nodes.contract import LinearPlant, LinearSensor, Matrix
from nodes.estimators.secure_distributed import SecureDistributed
from nodes.estimators.secure_distributed_boundedness import (
    boundedness,
    largest_bounded_coupling,
    sufficient_condition,
)

_SECURE_DISTRIBUTED = f"{SecureDistributed.__module__}:{SecureDistributed.__name__}"
_GILBERT_ELLIOTT = f"{GilbertElliott.__module__}:{GilbertElliott.__name__}"
_COUPLING_ACCURACY = 0.05  # relative; every halving takes a few hundred milliseconds more

Models = Sequence[tuple[Matrix, Matrix]]
"""The (C, R) of each member's one sensor."""


def advice(plan: Plan) -> list[str]:
    """Return remarks on a plan's methods, a line each; none when there is nothing to say."""
    members = [own for own in plan.estimators if own.kind.reference == _SECURE_DISTRIBUTED and own.neighbours]
    settings = {(own.kind.parameters["coupling"], own.kind.parameters["threshold"]) for own in members}
    if len(settings) != 1:
        return []
    return _boundedness_advice(plan, members, *settings.pop())


def _channel_rates(plan: Plan, members: Sequence[EstimatorPlan]) -> tuple[float, float] | None:
    """Return the failure and recovery rate of the one Gilbert-Elliott law between the members, if any."""
    names = {own.name for own in members}
    between = {
        label for link in plan.links_of(keys.EXCHANGE) if link.source in names for label in link.stages
    }
    laws = {
        (stage.kind.parameters.get("failure"), stage.kind.parameters.get("recovery"))
        for stage in plan.stages
        if stage.label in between and stage.kind.reference == _GILBERT_ELLIOTT
    }
    if len(laws) != 1:
        return None
    failure, recovery = laws.pop()
    return None if failure is None or recovery is None else (failure, recovery)


def _boundedness_advice(
    plan: Plan, members: Sequence[EstimatorPlan], coupling: float, threshold: float
) -> list[str]:
    plant = build_plant(plan)
    heard = [[build_sensor(plan, name, plant) for name in own.sensors] for own in members]
    models: Models = [
        (sensors[0].C, sensors[0].R)
        for sensors in heard
        if len(sensors) == 1 and isinstance(sensors[0], LinearSensor)
    ]
    if not isinstance(plant, LinearPlant) or len(models) < len(members):
        return []
    rates = _channel_rates(plan, members)
    theorem = [] if rates is None else [_theorem_line(plant, members, models, rates, coupling, threshold)]
    return [*theorem, _bound_line(plant, members, models, coupling)]


def _theorem_line(
    plant: LinearPlant,
    members: Sequence[EstimatorPlan],
    models: Models,
    rates: tuple[float, float],
    coupling: float,
    threshold: float,
) -> str:
    condition = sufficient_condition(
        plant.A,
        [C for C, _ in models],
        failure=rates[0],
        recovery=rates[1],
        coupling=coupling,
        degrees=[len(own.neighbours) for own in members],
        threshold=threshold,
    )
    verdict = (
        "both below 1: the bound is proved to stay bounded"
        if condition.holds
        else "the condition fails (both must be below 1), so it proves nothing here"
    )
    return (
        f"secure_distributed, Theorem 4 of Ding et al. (2021): xi_p = {condition.xi_p:.3f}, "
        f"xi_q = {condition.xi_q:.3f} (zeta = {condition.zeta:.3f}); {verdict}"
    )


def _bound_line(plant: LinearPlant, members: Sequence[EstimatorPlan], models: Models, coupling: float) -> str:
    names = [own.name for own in members]
    adjacency = np.array([[float(name in own.neighbours) for name in names] for own in members])
    settled = boundedness(plant.A, plant.Q, models, adjacency, coupling)
    limit = largest_bounded_coupling(
        plant.A, plant.Q, models, adjacency, relative_accuracy=_COUPLING_ACCURACY
    )
    where = f"up to about {limit:.1g}" if limit < 1.0 - _COUPLING_ACCURACY else "at any"
    fate = "settles" if settled.bounded else "GROWS for ever"
    return (
        f"secure_distributed, with every packet arriving: the bound Pi {fate} at coupling {coupling:g} "
        f"(on this graph it settles {where})"
    )
