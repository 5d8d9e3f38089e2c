"""One process of a run: it joins the bus, runs its programs as messages come, and says when it is done."""

from __future__ import annotations

import gc
import resource
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec

from bus import keys
from bus.grants import hears, inputs, outputs
from bus.intake import Intake
from bus.messages import Finished, encode
from bus.plan import Plan
from bus.program import Port, Program, Scheduler
from bus.zenoh_bus import Client

_START, _STOP = (
    1,
    2,
)  # subscriptions beside the data's; a fast neighbour's slot may overtake the start, and waits
_MEMORY_UNIT = 1 if sys.platform == "darwin" else 1024


@dataclass(frozen=True)
class Membership:
    """How one process gets onto the bus of its run: where the router is, and as whom."""

    run: str
    endpoint: str
    name: str
    password: str
    stall_s: float
    window: int


Build = Callable[[Port], Sequence[tuple[Program, Sequence[str]]]]
"""Makes the programs of a process, each with the topics it receives, around the port they send through."""


class _BusPort:
    """Sends messages under the run's prefix."""

    def __init__(self, client: Client, prefix: str) -> None:
        self._client = client
        self._prefix = prefix

    def send(self, topic: str, message: msgspec.Struct) -> None:
        self._client.put(self._prefix + topic, encode(message))


def rounds_of_topics(plan: Plan) -> dict[str, int]:
    """Return the slots in a step of every exchange topic."""
    return {
        topic: own.rounds
        for own in plan.estimators
        for topic in (keys.tx(own.name, keys.EXCHANGE), keys.rx(own.name, keys.EXCHANGE))
    }


def _messages_a_step(plan: Plan, name: str) -> int:
    rounds = rounds_of_topics(plan)
    return sum(rounds.get(topic, 1) for topic in inputs(plan, name))


def run_process(plan: Plan, own: Membership, build: Build) -> None:
    """Take part in a run from the first step to the last.

    Raises `BusTimeout` when nothing comes for longer than supervision would wait, and whatever the programs raise.
    """
    prefix = keys.prefix(own.run)
    patience_s = 2.0 * own.stall_s + 10.0  # supervision speaks first, and knows more
    with Client(
        own.endpoint,
        own.name,
        own.password,
        subscribe=[prefix + topic for topic in (hears(plan, own.name), keys.START, keys.STOP)],
        publish=[prefix + topic for topic in (*outputs(plan, own.name), keys.finished(own.name))],
        backlog=_messages_a_step(plan, own.name) * (own.window + 1) + 1,
        stall_s=own.stall_s,
    ) as client:
        port = _BusPort(client, prefix)
        scheduler = Scheduler()
        for program, topics in build(port):
            scheduler.add(program, topics)
        gc.freeze()  # what is there now stays; collections need not look at it again
        client.announce(prefix + keys.alive(own.name))
        client.receive(patience_s, _START)
        intake = Intake(rounds_of_topics(plan))
        scheduler.run()
        while not scheduler.finished:
            key, payload = client.receive(patience_s)
            topic = key.removeprefix(prefix)
            message = intake.admit(topic, payload)
            if message is not None:
                scheduler.deliver(topic, message)
                scheduler.run()
        port.send(keys.finished(own.name), _last_words(intake))
        client.receive(patience_s, _STOP)


def _last_words(intake: Intake) -> Finished:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return Finished(
        cpu_s=usage.ru_utime + usage.ru_stime,
        peak_memory_bytes=usage.ru_maxrss * _MEMORY_UNIT,
        rejected=dict(intake.rejected),
    )
