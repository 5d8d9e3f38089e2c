"""One link with its stages: who acts in which slot. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from bus.packets import ORACLE, Packet, Vector
from bus.plan import LinkPlan
from bus.schedules import Timing
from channel.contract import NEVER, Lane, Ledger, Slot, Stage


class PlacedLane:
    """A lane with its timing; ``quiet`` is the first step in which it must be called again.

    A ``plain`` one has no timing and keeps nothing: all there is to do is to let it act in every slot.
    """

    __slots__ = (
        "act",
        "first",
        "is_active",
        "keeps",
        "lane",
        "last",
        "looks_ahead",
        "plain",
        "quiet",
        "rest",
    )

    def __init__(self, timing: Timing, lane: Lane, last_step: int) -> None:
        self.first, self.last = timing.first, timing.last
        self.is_active = None if timing.schedule is None else timing.schedule.active
        self.lane = lane
        self.act = lane.act
        self.keeps = type(lane).rest is not Lane.rest
        self.rest = lane.rest if self.keeps else None
        knows = type(lane).quiet_until is not Lane.quiet_until
        has_window = timing.first > 0 or timing.last < last_step
        self.looks_ahead = knows or (has_window and not self.keeps)
        self.plain = not (self.looks_ahead or self.keeps or has_window or timing.schedule)
        self.quiet = 0

    def ahead(self, step: int) -> int:
        """Return the first step from the given one on in which it must be called."""
        if self.lane.held:
            return step
        if step > self.last:
            return NEVER
        return self.lane.quiet_until(max(step, self.first))


class Link:
    """One link's stages, each with its timing, and who receives what is left.

    ``receiver`` is the number of its receiver, ``place`` that of its slot in the receiver's inbox, and
    ``oracles`` are the stages of which the receiver is told.

    Before the step ``quiet`` only the ``plain`` ones among the stages need be called.
    """

    __slots__ = (
        "destination",
        "keepers",
        "name",
        "number",
        "oracles",
        "place",
        "placed",
        "plain",
        "quiet",
        "receiver",
        "source",
    )

    def __init__(
        self,
        number: int,
        plan: LinkPlan,
        receiver: int,
        place: int,
        stages: Mapping[str, tuple[Timing, Stage]],
        last_step: int,
        oracles: Collection[str] = (),
    ) -> None:
        self.number = number
        self.name = plan.name
        self.source = plan.source
        self.destination = plan.destination
        self.receiver = receiver
        self.place = place
        lanes = [(timing, stage.lane(plan.name)) for timing, stage in map(stages.__getitem__, plan.stages)]
        self.placed = [PlacedLane(timing, lane, last_step) for timing, lane in lanes if not _is_idle(lane)]
        self.keepers = [placed.lane for placed in self.placed if placed.keeps]
        self.plain = [placed.act for placed in self.placed if placed.plain]
        told = [label in oracles for label in plan.stages]
        self.oracles = [own for own, is_told in zip(lanes, told, strict=True) if is_told]
        self.quiet = 0 if len(self.plain) < len(self.placed) else NEVER

    def carry(
        self, slot: Slot, packets: Sequence[Packet], ledger: Ledger, next_step: int
    ) -> Sequence[Packet]:
        """Return what the stages make of a slot; ``next_step`` is that of the link's next one."""
        step = slot.step
        quiet = NEVER
        for placed in self.placed:
            if placed.quiet <= step:
                is_active = placed.is_active
                if placed.first <= step <= placed.last and (is_active is None or is_active(step)):
                    packets = placed.act(slot, packets, ledger)
                elif placed.rest is not None:
                    packets = placed.rest(slot, packets, ledger)
                if placed.looks_ahead:
                    placed.quiet = placed.ahead(next_step)
            if placed.quiet < quiet and not placed.plain:
                quiet = placed.quiet
        self.quiet = quiet
        return packets

    def told(self, slot: Slot, packets: Sequence[Packet]) -> Packet | None:
        """Return what the receiver is told of a slot in which packets were sent: what its stages add, in all.

        None in a step in which none of them may act.
        """
        if not packets:
            return None
        step = slot.step
        values = packets[0].values
        added: Vector | None = None
        for timing, lane in self.oracles:
            more = lane.reveal(slot, values) if timing.first <= step <= timing.last else None
            if more is not None:
                added = more if added is None else added + more
                values = values + more
        return None if added is None else Packet(self.source, step, step, ORACLE, added)


def _is_idle(lane: Lane) -> bool:
    """Tell whether a lane hands on what it gets, always."""
    return type(lane).act is Lane.act and type(lane).rest is Lane.rest
