"""The recorder: takes messages in any order and writes whole steps in the canonical one."""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Iterable, Mapping
from typing import Protocol

from bus.plan import Plan
from orchestrator.log.errors import LogError
from orchestrator.log.order import Slot, canonical_order, owner, silent_from

OTHER = "(other topics)"
"""Where rejected messages are counted when too many unknown topics were seen already."""
_MAX_COUNTED_TOPICS = 1000


_DEPARTED = "departed."


def outcome_facts(steps_recorded: int, steps: int) -> dict[str, str]:
    """Return what a log says at its end about how much of its plan it holds."""
    return {"complete": str(steps_recorded == steps).lower(), "steps_recorded": str(steps_recorded)}


def departures(outcome: Mapping[str, str]) -> dict[str, int]:
    """Return the first silent step of each node that died though no plan had it so, from a log's outcome."""
    return {
        key.removeprefix(_DEPARTED): int(step) for key, step in outcome.items() if key.startswith(_DEPARTED)
    }


class StepWriter(Protocol):
    """Where whole steps go: a `LogWriter`, or a scorer, or both in turn."""

    def write_step(self, step: int, messages: Iterable[tuple[str, bytes]]) -> None:
        """Take a step's (topic, payload) in canonical order."""
        ...


class _Step:
    """The payloads of one open step by their place in the canonical order, and how many are still missing."""

    __slots__ = ("missing", "payloads")

    def __init__(self, size: int) -> None:
        self.payloads: list[bytes | None] = [None] * size
        self.missing = size


class Recorder:
    """Stores every message of a plan exactly once.

    Steps below ``steps_recorded`` are written; at most ``window + 1`` steps from there on are open. A message
    that nobody expects, or that came before, is counted by topic in ``rejected`` and otherwise ignored.
    """

    def __init__(self, plan: Plan, writer: StepWriter, window: int) -> None:
        self._slots = canonical_order(plan)
        self._topics = tuple(slot.topic for slot in self._slots)
        self._index = {tuple(slot): index for index, slot in enumerate(self._slots)}
        self._steps = plan.steps
        self._silent_from = sorted(silent_from(plan, slot) for slot in self._slots)
        self._silent = {
            index: step
            for index, slot in enumerate(self._slots)
            if (step := silent_from(plan, slot)) < plan.steps
        }
        self._writer = writer
        self._window = window
        self._open: dict[int, _Step] = {}
        self.steps_recorded = 0
        self.rejected: dict[str, int] = {}
        self.departed: dict[str, int] = {}
        """The first step without some message of each node that `expect_no_more_of`."""

    @property
    def complete(self) -> bool:
        """Whether every message of every step of the plan is written."""
        return self.steps_recorded == self._steps

    def store(self, topic: str, round_: int, step: int, payload: bytes) -> int:
        """Take a message; write the steps that it makes whole; return ``steps_recorded``.

        Raises LogError for a step beyond the window, or when the log cannot be written.
        """
        index = self._index.get((topic, round_))
        if index is None or not self.steps_recorded <= step < self._steps:
            return self._reject(topic)
        open_step = self._open.get(step)
        if open_step is None:
            open_step = self._begin(topic, step)
        if open_step.payloads[index] is not None:
            return self._reject(topic)
        open_step.payloads[index] = payload
        open_step.missing -= 1
        if not open_step.missing and step == self.steps_recorded:
            self._write_whole_steps()
        return self.steps_recorded

    def _begin(self, topic: str, step: int) -> _Step:
        if step > self.steps_recorded + self._window:
            raise LogError(
                f"{topic} is at step {step} while step {self.steps_recorded} is not whole: nobody may be "
                f"more than {self._window} steps ahead; let its program wait for inputs, or widen the window"
            )
        begun = self._open[step] = _Step(len(self._slots))
        begun.missing -= bisect_right(self._silent_from, step)
        return begun

    def _reject(self, topic: str) -> int:
        if topic not in self.rejected and len(self.rejected) >= _MAX_COUNTED_TOPICS:
            topic = OTHER
        self.rejected[topic] = self.rejected.get(topic, 0) + 1
        return self.steps_recorded

    def _write_whole_steps(self) -> None:
        while (step := self._open.get(self.steps_recorded)) is not None and not step.missing:
            self._write(self.steps_recorded, self._open.pop(self.steps_recorded))
            self.steps_recorded += 1

    def _write(self, number: int, step: _Step) -> None:
        slots = zip(self._topics, step.payloads, strict=True)
        self._writer.write_step(number, [(topic, payload) for topic, payload in slots if payload is not None])

    def expect_no_more_of(self, node: str) -> dict[Slot, int]:
        """Let a node be silent after what has come of it; return the first step that lacks each message.

        The messages of each slot must have come in the order of their steps. Steps that waited for the node
        alone are written.
        """
        lacking: dict[Slot, int] = {}
        for index, slot in enumerate(self._slots):
            if owner(slot.topic) != node:
                continue
            before = self._silent.get(index, self._steps)
            step = self.steps_recorded
            while step in self._open and self._open[step].payloads[index] is not None:
                step += 1
            lacking[slot] = self._silent[index] = min(step, before)
            self._silent_from.remove(before)
            insort(self._silent_from, self._silent[index])
            for number, open_step in self._open.items():
                open_step.missing -= step <= number < before
        self.departed[node] = min(lacking.values(), default=self._steps)
        self._write_whole_steps()
        return lacking

    def missing(self) -> tuple[Slot, ...]:
        """Return what the lowest incomplete step lacks, in canonical order; nothing when all is recorded."""
        if self.complete:
            return ()
        step = self._open.get(self.steps_recorded)
        if step is None:
            first = self._silent
            return tuple(
                slot
                for index, slot in enumerate(self._slots)
                if self.steps_recorded < first.get(index, self._steps)
            )
        first = self._silent
        return tuple(
            slot
            for index, (slot, payload) in enumerate(zip(self._slots, step.payloads, strict=True))
            if payload is None and self.steps_recorded < first.get(index, self._steps)
        )

    def write_partial_steps(self) -> None:
        """Write what there is of the incomplete steps, in canonical order: an aborted run's last act."""
        for number in sorted(self._open):
            self._write(number, self._open.pop(number))

    def outcome(self) -> dict[str, str]:
        """Return what the log shall say at its end about how much of its plan it holds."""
        gone = {f"{_DEPARTED}{node}": str(step) for node, step in sorted(self.departed.items())}
        return {**outcome_facts(self.steps_recorded, self._steps), **gone}
