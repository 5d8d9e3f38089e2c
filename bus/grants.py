"""Who of a run's processes may say and hear what: an estimator neither the truth nor in another's name."""

from __future__ import annotations

from bus import keys
from bus.access import Grant
from bus.plan import Plan

CHANNEL = "channel"
"""The name of the channel process, on the bus and in its own log file."""


def paced(plan: Plan) -> tuple[str, ...]:
    """Return the nodes that wait for the recorder's credits: the plant, and estimators without a sensor."""
    return (plan.plant.name, *(own.name for own in plan.estimators if not own.sensors))


def inputs(plan: Plan, name: str) -> tuple[str, ...]:
    """Return the topics that a process receives while the run goes on."""
    if name == CHANNEL:
        sent = {keys.tx(link.source, link.stream) for link in plan.links}
        return tuple(sorted(sent | {keys.tx(node, keys.WATCH) for node in plan.watched}))
    if name == plan.plant.name:
        return (keys.credit(name), *_controlled(name, plan.plant.controllers))
    for own in plan.estimators:
        if own.name == name:
            measured = (keys.rx(name, keys.CORRECT),) if own.sensors else (keys.credit(name),)
            exchanged = (keys.rx(name, keys.EXCHANGE),) if own.rounds and own.neighbours else ()
            return (*measured, *exchanged, *_controlled(name, own.controllers))
    for controller in plan.controllers:
        if controller.name == name:
            return (keys.estimate(controller.estimator),)
    return (keys.truth(plan.plant.name),)


def _controlled(name: str, controllers: tuple[str, ...]) -> tuple[str, ...]:
    return (keys.rx(name, keys.CONTROL),) if controllers else ()


def subscriptions(plan: Plan, name: str) -> tuple[str, ...]:
    """Return the key expressions to which a process subscribes for its inputs.

    A node has one for each of its topics, so that it can wait for the very one that it needs and sleep
    through the others. The channel takes whatever comes, from one.
    """
    return (keys.tx("*", "*"),) if name == CHANNEL else inputs(plan, name)


def outputs(plan: Plan, name: str) -> tuple[str, ...]:
    """Return the topics on which a process sends while the run goes on."""
    if name == CHANNEL:
        streams = {link.stream for link in plan.links}
        phases = [keys.phase_of(stream) for stream in sorted(streams)]
        receivers = sorted({(link.destination, keys.phase_of(link.stream)) for link in plan.links})
        return (*map(keys.channel, phases), *(keys.rx(node, phase) for node, phase in receivers))
    watched = (keys.tx(name, keys.WATCH),) if name in plan.watched else ()
    if name == plan.plant.name:
        return (keys.truth(name), *watched)
    if any(own.name == name for own in plan.estimators):
        exchanged = (keys.tx(name, keys.EXCHANGE),) if plan.is_heard(name, keys.EXCHANGE) else ()
        return (*exchanged, keys.estimate(name), *watched)
    if any(own.name == name for own in plan.controllers):
        return (keys.tx(name, keys.CONTROL),)
    return (keys.tx(name, keys.MEASUREMENT),)


def process_names(plan: Plan) -> tuple[str, ...]:
    """Return the names of all processes of a run: its nodes, and the channel when there are links."""
    return (*plan.node_names, CHANNEL) if plan.links else plan.node_names


def grant(plan: Plan, run: str, name: str) -> Grant:
    """Return what one process of a run may do."""
    prefix = keys.prefix(run)

    def spelled(topics: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(prefix + topic for topic in topics)

    return Grant(
        user=name,
        may_put=spelled((*outputs(plan, name), keys.finished(name))),
        may_subscribe=spelled((*subscriptions(plan, name), keys.START, keys.STOP)),
        alive=prefix + keys.alive(name),
    )
