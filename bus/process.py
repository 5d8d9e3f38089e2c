"""One process of a run: it joins the bus, runs its programs as messages come, and says when it is done."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from bus import keys
from bus.grants import inputs, outputs, subscriptions
from bus.intake import Intake
from bus.messages import Finished, Message, encode
from bus.plan import Plan
from bus.program import Port, Program, Scheduler, run_alone
from bus.usage import own_usage
from bus.zenoh.client import Client


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

    def __init__(self, client: Client, run: str, topics: Sequence[str]) -> None:
        self._put = client.put
        self._keys = {topic: keys.prefix(run) + topic for topic in topics}

    def send(self, topic: str, message: Message | Finished) -> None:
        self._put(self._keys[topic], encode(message))


def rounds_of_topics(plan: Plan) -> dict[str, int]:
    """Return the slots in a step of every exchange topic."""
    rounds = {
        topic: own.rounds
        for own in plan.estimators
        for topic in (keys.tx(own.name, keys.EXCHANGE), keys.rx(own.name, keys.EXCHANGE))
    }
    heard = {link.source for link in plan.links_of(keys.EXCHANGE)}
    most = max((own.rounds for own in plan.estimators if own.name in heard), default=1)
    return rounds | {keys.channel(keys.EXCHANGE): most}


def _messages_a_step(plan: Plan, name: str) -> int:
    rounds = rounds_of_topics(plan)
    return sum(rounds.get(topic, 1) for topic in inputs(plan, name))


class _Receiver:
    """Receives from the bus, lets in what is admitted, and waits no longer than supervision would."""

    def __init__(self, client: Client, plan: Plan, own: Membership) -> None:
        self._client = client
        self._prefix = keys.prefix(own.run)
        self._subscription = {topic: number for number, topic in enumerate(subscriptions(plan, own.name))}
        self._patience_s = 2.0 * own.stall_s + 10.0  # supervision speaks first, and knows more
        self.intake = Intake(rounds_of_topics(plan))
        self._own_way = {
            topic: (number, self.intake.turnstile(topic).admit)
            for topic, number in self._subscription.items()
            if topic in inputs(plan, own.name)
        }

    def tells_apart(self, topics: Sequence[str]) -> bool:
        """Return whether each of the topics has a subscription of its own."""
        return all(topic in self._own_way for topic in topics)

    def wait_for(self, topic: str) -> None:
        """Wait for the orchestrator's word."""
        words = {keys.START: len(self._subscription), keys.STOP: len(self._subscription) + 1}
        self._client.receive(self._patience_s, words[topic])

    def next_of(self, topic: str) -> Any:
        """Return the next message of a topic that has a subscription of its own."""
        number, admit = self._own_way[topic]
        while True:
            message = admit(self._client.take(self._patience_s, number))
            if message is not None:
                return message

    def next_of_any(self) -> tuple[str, Any]:
        """Return the next message of the first subscription, with its topic."""
        while True:
            key, payload = self._client.receive(self._patience_s)
            topic = key.removeprefix(self._prefix)
            message = self.intake.admit(topic, payload)
            if message is not None:
                return topic, message


def _run_programs(programs: Sequence[tuple[Program, Sequence[str]]], receiver: _Receiver) -> None:
    """Run a node's program, which knows what it waits for, or several programs on whatever comes."""
    if len(programs) == 1 and receiver.tells_apart(programs[0][1]):
        run_alone(programs[0][0], receiver.next_of)
        return
    scheduler = Scheduler()
    for program, topics in programs:
        scheduler.add(program, topics)
    scheduler.run()
    while not scheduler.finished:
        scheduler.deliver(*receiver.next_of_any())
        scheduler.run()


def run_process(plan: Plan, own: Membership, build: Build) -> None:
    """Take part in a run from the first step to the last.

    Raises `bus.zenoh.session.BusTimeout` when nothing comes for longer than supervision would wait, and
    whatever the programs raise.
    """
    prefix = keys.prefix(own.run)
    with Client(
        own.endpoint,
        own.name,
        own.password,
        subscribe=[prefix + topic for topic in (*subscriptions(plan, own.name), keys.START, keys.STOP)],
        publish=[prefix + topic for topic in (*outputs(plan, own.name), keys.finished(own.name))],
        backlog=_messages_a_step(plan, own.name) * (own.window + 1) + 1,
        stall_s=own.stall_s,
    ) as client:
        port = _BusPort(client, own.run, (*outputs(plan, own.name), keys.finished(own.name)))
        programs = build(port)
        receiver = _Receiver(client, plan, own)
        gc.freeze()  # what is there now stays; collections need not look at it again
        client.announce(prefix + keys.alive(own.name))
        receiver.wait_for(
            keys.START
        )  # a fast neighbour's slot may overtake it, and waits in its subscription
        _run_programs(programs, receiver)
        if any(fault.node == own.name for fault in plan.faults):
            _suffer(plan, own.name)
            return
        port.send(keys.finished(own.name), _last_words(receiver.intake))
        receiver.wait_for(keys.STOP)


def _suffer(plan: Plan, name: str) -> None:
    """Fall silent as the plan says: hang for ever, or return to crash once all that was sent is out."""
    if any(fault.node == name and fault.kind == "hang" for fault in plan.faults):
        threading.Event().wait()


def _last_words(intake: Intake) -> Finished:
    cpu_s, peak_memory_bytes = own_usage()
    return Finished(cpu_s=cpu_s, peak_memory_bytes=peak_memory_bytes, rejected=dict(intake.rejected))
