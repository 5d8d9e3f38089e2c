"""One process of a run: it joins the bus, runs its programs as messages come, and says when it is done."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec

from bus import keys
from bus.grants import inputs, outputs
from bus.intake import Intake
from bus.messages import Finished, encode
from bus.plan import Plan
from bus.program import Port, Program, Scheduler
from bus.zenoh_bus import BusTimeout, Client

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


def run_process(plan: Plan, own: Membership, build: Build) -> None:
    """Take part in a run from the first step to the last.

    Raises `BusTimeout` when nothing comes for longer than supervision would wait, and whatever the programs raise.
    """
    prefix = keys.prefix(own.run)
    patience_s = 2.0 * own.stall_s + 10.0  # supervision speaks first, and knows more
    subscribe = [prefix + topic for topic in (*inputs(plan, own.name), keys.START, keys.STOP)]
    publish = [prefix + topic for topic in (*outputs(plan, own.name), keys.finished(own.name))]
    with Client(
        own.endpoint, own.name, own.password, subscribe=subscribe, publish=publish, stall_s=own.stall_s
    ) as client:
        port = _BusPort(client, prefix)
        scheduler = Scheduler()
        for program, topics in build(port):
            scheduler.add(program, topics)
        client.announce(prefix + keys.alive(own.name))
        intake = Intake(rounds_of_topics(plan))
        started = False
        while not (started and scheduler.finished):
            key, payload = client.receive(patience_s)
            topic = key.removeprefix(prefix)
            if topic == keys.START:
                started = True
            elif (message := intake.admit(topic, payload)) is not None:
                scheduler.deliver(topic, message)  # a fast neighbour's slot may overtake the start
            if started:
                scheduler.run()
        port.send(keys.finished(own.name), _last_words(intake))
        _await(client, prefix + keys.STOP, patience_s)


def _await(client: Client, key: str, patience_s: float) -> None:
    """Wait for the orchestrator's word; what else comes after the last step is of no use."""
    deadline = time.monotonic() + patience_s
    while True:
        left_s = deadline - time.monotonic()
        if left_s <= 0.0:
            raise BusTimeout(f"no word on {key} for {patience_s:g} s")
        if client.receive(left_s)[0] == key:
            return


def _last_words(intake: Intake) -> Finished:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return Finished(
        cpu_s=usage.ru_utime + usage.ru_stime,
        peak_memory_bytes=usage.ru_maxrss * _MEMORY_UNIT,
        rejected=dict(intake.rejected),
    )
