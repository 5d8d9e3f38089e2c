"""The start-up proof of a run's rules: one process of every role is tried, with its real credential."""

from __future__ import annotations

from bus import keys
from bus.grants import CHANNEL
from bus.plan import Plan
from bus.refusals import Probe, prove_refusals
from bus.zenoh.router import Router


def probes(plan: Plan, run: str) -> list[Probe]:
    """Return what a process of each role must be refused, beside something that it is granted."""
    truth = keys.truth(plan.plant.name)
    foreign = keys.tx("nobody", keys.EXCHANGE)
    tried = [(plan.plant.name, foreign, foreign, truth, keys.credit(plan.plant.name))]
    if plan.sensors:
        sensor = plan.sensors[0].name
        tried.append((sensor, truth, foreign, keys.tx(sensor, keys.MEASUREMENT), truth))
    if plan.estimators:
        estimator = plan.estimators[0].name
        another = keys.estimate(plan.estimators[-1].name if len(plan.estimators) > 1 else "nobody")
        tried.append((estimator, another, truth, keys.estimate(estimator), keys.START))
    if plan.links:
        link = plan.links[0]
        inbox = keys.rx(link.destination, keys.phase_of(link.stream))
        tried.append((CHANNEL, truth, truth, inbox, keys.tx(link.source, link.stream)))
    prefix = keys.prefix(run)
    return [Probe(user, *(prefix + topic for topic in topics)) for user, *topics in tried]


def prove_the_rules(router: Router, plan: Plan, run: str) -> None:
    """Raise `bus.zenoh.session.BusError` unless the router refuses what this run's rules forbid.

    An estimator hears no truth and speaks in no other's name; nobody but the plant says what is true.
    """
    prove_refusals(router, probes(plan, run))
