"""Programs: what runs on the bus, written once for one process and for many.

A program is a generator that yields the topic it waits for and is sent the next message of that topic. It
sends through a `Port`, which never blocks it. Such programs form a Kahn process network: what they compute
cannot depend on the order in which they are run, only on what they are sent.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from typing import Any, Protocol

from bus.messages import Message

Program = Generator[str, Any, None]


class Form(Protocol):
    """What a program has to say, as the mathematics has it: packets, arrays. A message tells the same."""

    @property
    def step(self) -> int:
        """The step that it belongs to."""
        ...

    def message(self) -> Message:
        """Return the message that tells it."""
        ...


class Port(Protocol):
    """Where a program sends to.

    One that keeps to this process may have ``outlet(topic)``, too: it returns what hands each `Form` of a
    topic on as it is.
    """

    def send(self, topic: str, message: Message) -> None:
        """Send a message on a topic."""
        ...


def outlet(port: Port, topic: str) -> Callable[[Form], None]:
    """Return what sends forms on a topic: as they are where the port carries them, else as messages."""
    make: Callable[[str], Callable[[Form], None]] | None = getattr(port, "outlet", None)
    return make(topic) if make else lambda form: port.send(topic, form.message())


class NodeError(RuntimeError):
    """A node's own code raised; the cause is chained."""

    def __init__(self, name: str, step: int, cause: BaseException) -> None:
        super().__init__(f"{name} failed in step {step}: {type(cause).__name__}: {cause}")
        self.name = name
        self.step = step

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by parts: the cause crosses process borders as its text."""
        return (NodeError, (self.name, self.step, RuntimeError(str(self))))


def every_step(name: str, steps: int, one_step: Callable[[int], Program]) -> Program:
    """Run ``one_step(k)`` for k = 0 .. steps - 1; what it raises becomes a `NodeError` with name and step."""
    for step in range(steps):
        try:
            yield from one_step(step)
        except Exception as error:
            raise NodeError(name, step, error) from error


def run_alone(program: Program, receive: Callable[[str], Any]) -> None:
    """Run one program to its end; ``receive`` waits for the next message of a topic."""
    try:
        topic = next(program)
        while True:
            topic = program.send(receive(topic))
    except StopIteration:
        return


class _Task:
    """A program, a queue for each of its topics, and the topic it waits for (None when it does not)."""

    __slots__ = ("program", "queues", "send", "waits_for")

    def __init__(self, program: Program, topics: Sequence[str]) -> None:
        self.program = program
        self.send = program.send
        self.queues: dict[str, deque[Any]] = {topic: deque() for topic in topics}
        self.waits_for: str | None = None


class Scheduler:
    """Runs programs side by side in one thread, each as far as its messages allow."""

    def __init__(self) -> None:
        self._readers: dict[str, list[tuple[_Task, deque[Any]]]] = {}
        self._outlets: dict[str, Callable[[Any], None]] = {}
        self._ready: deque[tuple[_Task, Any]] = deque()
        self._new: list[_Task] = []
        self._unfinished = 0

    @property
    def finished(self) -> bool:
        """Whether every program has ended."""
        return self._unfinished == 0

    def add(self, program: Program, receives: Sequence[str]) -> None:
        """Add a program and the topics that it will wait for."""
        task = _Task(program, receives)
        for topic in receives:
            self._readers.setdefault(topic, []).append((task, task.queues[topic]))
        self._new.append(task)
        self._unfinished += 1

    def outlet(self, topic: str, tap: Callable[[Any], None] | None = None) -> Callable[[Any], None]:
        """Return what hands a topic's messages to the programs that wait, and queues them for the others.

        The tap is shown each message before.
        """
        readers, make_ready = self._readers.setdefault(topic, []), self._ready.append

        def hand(message: Any) -> None:
            if tap is not None:
                tap(message)
            for task, queue in readers:
                if task.waits_for == topic:
                    task.waits_for = None
                    make_ready((task, message))
                else:
                    queue.append(message)

        return hand

    def deliver(self, topic: str, message: Any) -> None:
        """Hand a message to every program that waits for it, and queue it for those that will."""
        hand = self._outlets.get(topic)
        if hand is None:
            hand = self._outlets[topic] = self.outlet(topic)
        hand(message)

    def run(self) -> None:
        """Run until every program waits for a message that is not there, or has ended."""
        while self._new:
            task = self._new.pop(0)
            try:
                self._settle(task, next(task.program))
            except StopIteration:
                self._unfinished -= 1
        ready = self._ready
        while ready:
            task, message = ready.popleft()
            send, queues = task.send, task.queues
            try:
                while queue := queues[topic := send(message)]:
                    message = queue.popleft()
                task.waits_for = topic
            except StopIteration:
                self._unfinished -= 1

    def _settle(self, task: _Task, topic: str) -> None:
        """Let a task wait for a topic, or make it ready when a message is there already."""
        queue = task.queues[topic]
        if queue:
            self._ready.append((task, queue.popleft()))
        else:
            task.waits_for = topic
