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


def advice(plan: Plan) -> list[str]:
    """Return remarks on a plan's methods, a line each; none when there is nothing to say."""
    members = [own for own in plan.estimators if own.kind.reference == _SECURE_DISTRIBUTED and own.neighbours]
    couplings = {own.kind.parameters["coupling"] for own in members}
    if not members or len(couplings) != 1:
        return []
    return _boundedness_advice(plan, members, couplings.pop())


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


def _boundedness_advice(plan: Plan, members: Sequence[EstimatorPlan], coupling: float) -> list[str]:
    plant = build_plant(plan)
    sensors = [[build_sensor(plan, heard, plant) for heard in own.sensors] for own in members]
    if not isinstance(plant, LinearPlant) or not all(
        len(heard) == 1 and isinstance(heard[0], LinearSensor) for heard in sensors
    ):
        return []
    models: list[tuple[Matrix, Matrix]] = [(heard[0].C, heard[0].R) for heard in sensors]  # type: ignore[attr-defined]
    names = [own.name for own in members]
    adjacency = np.array([[float(name in own.neighbours) for name in names] for own in members])
    lines = []
    rates = _channel_rates(plan, members)
    if rates is not None:
        condition = sufficient_condition(
            plant.A,
            [C for C, _ in models],
            failure=rates[0],
            recovery=rates[1],
            coupling=coupling,
            degrees=[len(own.neighbours) for own in members],
            threshold=members[0].kind.parameters["threshold"],
        )
        verdict = (
            "both below 1: the bound is proved to stay bounded"
            if condition.holds
            else "the condition fails (both must be below 1), so it proves nothing here"
        )
        lines.append(
            f"secure_distributed, Theorem 4 of Ding et al. (2021): xi_p = {condition.xi_p:.3f}, "
            f"xi_q = {condition.xi_q:.3f} (zeta = {condition.zeta:.3f}); {verdict}"
        )
    settled = boundedness(plant.A, plant.Q, models, adjacency, coupling)
    limit = largest_bounded_coupling(plant.A, plant.Q, models, adjacency)
    fate = "settles" if settled.bounded else "GROWS for ever"
    lines.append(
        f"secure_distributed, with every packet arriving: the bound Pi {fate} at coupling {coupling:g} "
        f"(on this graph it settles up to about {limit:.3f})"
    )
    return lines
