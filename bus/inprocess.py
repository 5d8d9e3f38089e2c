"""The in-process transport: all programs in one thread, no bus, the same messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from bus import keys
from bus.messages import Credit, Message
from bus.program import Form, Program, Scheduler

Sink = Callable[[str, Message], None]
"""Takes every message with its topic, in the order in which they happen to be sent."""

Carrier = Callable[[str], Callable[[Any], None] | None]
"""Returns what takes the forms of a topic, None when they are of no interest."""


class InProcessBus:
    """A port that hands every message to the sink and to the programs that receive it."""

    def __init__(self, sink: Sink, credits_to: Sequence[str]) -> None:
        self._sink = sink
        self._credits_to = credits_to
        self._scheduler = Scheduler()
        self._deliver = self._scheduler.deliver
        self._steps_begun = 0

    def add(self, program: Program, receives: Sequence[str]) -> None:
        """Add a program and the topics that it waits for."""
        self._scheduler.add(program, receives)

    def send(self, topic: str, message: Message) -> None:
        """Record a message and queue it for its receivers."""
        self._sink(topic, message)
        self._deliver(topic, message)
        if message.step >= self._steps_begun:
            self._steps_begun = message.step + 1

    def run(self) -> None:
        """Run all programs to their end; raises RuntimeError when they wait for each other for ever.

        When nobody can go on, all steps that have begun are whole: whoever is paced by credits gets them.
        """
        credited = -1
        while True:
            self._scheduler.run()
            if self._scheduler.finished:
                return
            if credited == self._steps_begun:
                raise RuntimeError(f"every node waits for another one in step {credited}")
            credited = self._steps_begun
            for name in self._credits_to:
                self._deliver(keys.credit(name), Credit(steps_recorded=credited))


class CarryingBus(InProcessBus):
    """A port that saves what it costs to make messages of packets and arrays, and to read them again.

    The programs compute the same, and sink and carrier are told what that of `InProcessBus` would be told.
    A step begins with the message of its truth.
    """

    def __init__(self, sink: Sink, carrier: Carrier, credits_to: Sequence[str]) -> None:
        super().__init__(sink, credits_to)
        self._carrier = carrier

    def outlet(self, topic: str) -> Callable[[Form], None]:
        """Return what shows a topic's forms to the carrier and queues them for their receivers."""
        return self._scheduler.outlet(topic, self._carrier(topic))
