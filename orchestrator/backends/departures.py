"""What is said in the place of nodes that died though no plan had it so, so that the others can go on."""

from __future__ import annotations

from collections.abc import Iterator

from bus import keys
from bus.messages import Transmission
from bus.plan import Plan
from orchestrator.log.order import Slot
from orchestrator.log.recorder import Recorder


def dependents(plan: Plan, node: str) -> tuple[str, ...]:
    """Return a node and the controllers that hear it: they say no more than it does."""
    return (node, *(own.name for own in plan.controllers if own.estimator == node))


class Departures:
    """Empty slots of dead senders, from the first that they left out to the last of the plan.

    They are for the channel alone: what the dead owed is not recorded.
    """

    def __init__(self, plan: Plan, recorder: Recorder) -> None:
        self._plan = plan
        self._recorder = recorder
        self._heard = {keys.tx(link.source, link.stream) for link in plan.links}
        self._owed: dict[str, Iterator[Transmission]] = {}
        self._next: dict[str, Transmission] = {}

    @property
    def topics(self) -> frozenset[str]:
        """The topics on which empty slots are sent in the place of the dead."""
        return frozenset(self._owed)

    def note(self, node: str) -> None:
        """Take a node for dead; everything that it sent must have been recorded."""
        lacking = self._recorder.expect_no_more_of(node)
        for topic in {slot.topic for slot in lacking} & self._heard:
            rounds = {slot: step for slot, step in lacking.items() if slot.topic == topic}
            self._owed[topic] = self._empty_slots(rounds)

    def _empty_slots(self, lacking: dict[Slot, int]) -> Iterator[Transmission]:
        """Yield a topic's empty slots in the order of steps and rounds."""
        for step in range(min(lacking.values()), self._plan.steps):
            for slot in sorted(lacking):
                if step >= lacking[slot]:
                    t = step * self._plan.period_s
                    yield Transmission(step=step, t=t, round=slot.round, sequence=[], offset=[], values=[])

    def due(self, before: int) -> Iterator[tuple[str, Transmission]]:
        """Yield the empty slots of steps below ``before`` that were not yielded yet, with their topics."""
        for topic in sorted(self._owed):
            while (slot := self._next.pop(topic, None) or next(self._owed[topic], None)) is not None:
                if slot.step >= before:
                    self._next[topic] = slot
                    break
                yield topic, slot
