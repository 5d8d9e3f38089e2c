"""What the channel did in one phase and round of a step, as it counted it: what `ChannelEvents` tells."""

from __future__ import annotations

from array import array
from collections.abc import Collection, Mapping, Sequence

import msgspec

from bus.messages import ChannelEvents
from channel.contract import ATTACKED, DUPLICATED, INJECTED, LOST, Event

REFUSED = "refused"
IN_FLIGHT = "in_flight"


class Happened(msgspec.Struct, frozen=True):
    """Counts by link, in the order of ``link``; ``counts`` holds those that are not zero, by what and link.

    Its properties are the fields of `ChannelEvents`; lists of counts are empty when all are zero.
    """

    step: int
    t: float
    round: int
    link: list[str]
    sent: array[int]
    delivered: array[int]
    counts: Mapping[str, Mapping[int, int]]
    events: Sequence[Event]

    @property
    def all_zero(self) -> Collection[str]:
        """What none of the links counted."""
        return [what for what, counts in self.counts.items() if not counts]

    def _spread(self, what: str) -> list[int]:
        counts = self.counts[what]
        if not counts:
            return []
        whole = [0] * len(self.link)
        for number, count in counts.items():
            whole[number] = count
        return whole

    @property
    def lost(self) -> list[int]:
        """The packets that stages lost."""
        return self._spread(LOST)

    @property
    def attacked(self) -> list[int]:
        """The packets that stages falsified."""
        return self._spread(ATTACKED)

    @property
    def injected(self) -> list[int]:
        """The packets that stages made."""
        return self._spread(INJECTED)

    @property
    def duplicated(self) -> list[int]:
        """The further copies that stages made."""
        return self._spread(DUPLICATED)

    @property
    def refused(self) -> list[int]:
        """The packets that were delivered and are sure to fail the receiver's check."""
        return self._spread(REFUSED)

    @property
    def in_flight(self) -> list[int]:
        """The packets that are kept for later slots."""
        return self._spread(IN_FLIGHT)

    @property
    def event_link(self) -> list[str]:
        """The link of each event."""
        return [event.link for event in self.events]

    @property
    def event_stage(self) -> list[str]:
        """The stage of each event."""
        return [event.stage for event in self.events]

    @property
    def event_sequence(self) -> list[int]:
        """The number of the packet of each event."""
        return [event.sequence for event in self.events]

    @property
    def event_action(self) -> list[str]:
        """What happened in each event."""
        return [event.action for event in self.events]

    @property
    def event_magnitude(self) -> list[float]:
        """By how much in each event."""
        return [event.magnitude for event in self.events]

    def message(self) -> ChannelEvents:
        """Return the message that tells it."""
        zeros = [0] * len(self.link)
        return ChannelEvents(
            step=self.step,
            t=self.t,
            round=self.round,
            link=self.link,
            sent=self.sent.tolist(),
            lost=self.lost or zeros,
            attacked=self.attacked or zeros,
            delivered=self.delivered.tolist(),
            injected=self.injected,
            duplicated=self.duplicated,
            refused=self.refused,
            in_flight=self.in_flight,
            event_link=self.event_link,
            event_stage=self.event_stage,
            event_sequence=self.event_sequence,
            event_action=self.event_action,
            event_magnitude=self.event_magnitude,
        )


def events_of(message: ChannelEvents | Happened) -> Sequence[Event]:
    """Return what happened to single packets; raises ValueError when its lists do not fit one another."""
    if isinstance(message, Happened):
        return message.events
    columns = (message.event_link, message.event_stage, message.event_sequence, message.event_action)
    return [Event(*event) for event in zip(*columns, message.event_magnitude, strict=True)]
