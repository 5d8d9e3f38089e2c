"""The channel's accounts of a record: how many packets each link carried, lost and owes."""

from __future__ import annotations

import numpy as np

from bus import keys
from bus.messages import ChannelEvents
from bus.plan import Plan
from channel.happened import Happened
from orchestrator.score.columns import COUNTS, Index, Ints, Ledger, Packets, ScoreError, integers


class Accounts:
    """Counts in the making; ``links`` numbers the links of the plan."""

    def __init__(self, plan: Plan, links: Index) -> None:
        self._plan = plan
        self._links = links
        self._open: dict[tuple[str, int], Ledger] = {}
        self.ledgers: list[Ledger] = []
        self._last: dict[tuple[str, int], ChannelEvents | Happened] = {}

    def take(self, topic: str, message: ChannelEvents | Happened) -> None:
        """Take the counts of one phase and round of a step."""
        place = topic, message.round
        ledger = self._open.get(place)
        if ledger is None or (ledger.link is not message.link and ledger.link != message.link):
            ledger = self._open[place] = Ledger(topic, message.round, message.link)
            self.ledgers.append(ledger)
        ledger.take(message)
        last = self._last.get(place)
        if last is None or message.step > last.step:
            self._last[place] = message

    def slots(self) -> Ints:
        """Return by link the slots that the channel passed."""
        slots = np.zeros(len(self._plan.links), dtype=np.int64)
        for ledger in self.ledgers:
            np.add.at(slots, [self._links[name] for name in ledger.link], len(ledger.step))
        return slots

    def sent(self) -> Ints:
        """Return the slots with a packet by sender and step; one link of a sender tells for its stream."""
        senders = {name: i for i, name in enumerate(self._plan.node_names)}
        sent = np.zeros((len(senders), self._plan.steps), dtype=np.int64)
        for ledger in self.ledgers:
            if ledger.topic == keys.channel(keys.CONTROL) or not ledger.link:
                continue
            first: dict[str, int] = {}  # a column by sender
            for column, name in enumerate(ledger.link):
                first.setdefault(self._plan.links[self._links[name]].source, column)
            has_sent = ledger.table("sent")[:, list(first.values())] > 0
            rows = np.array([senders[name] for name in first], dtype=np.int64)
            np.add.at(sent, (rows[None, :], integers(ledger.step)[:, None]), has_sent)
        return sent

    def counts(self, *acts: Packets) -> Ints:
        """Return the counts that `COUNTS` names by link, (8, L).

        ``acts`` are the rows about packets; one of a link or step outside the plan raises `ScoreError`.
        """
        names = [name for ledger in self.ledgers for name in ledger.link]
        if any(name not in self._links for name in names) or any((own.link < 0).any() for own in acts):
            raise ScoreError("the record holds packets of a link that the plan does not have")
        for step in (*(own.step for own in acts), *(integers(own.step) for own in self.ledgers)):
            if step.size and not (step.min() >= 0 and step.max() < self._plan.steps):
                raise ScoreError(f"the record holds packets of a step outside the plan's {self._plan.steps}")
        counts = np.zeros((len(COUNTS), len(self._plan.links)), dtype=np.int64)
        for ledger in self.ledgers:
            link = [self._links[name] for name in ledger.link]
            for row, name in zip(counts, ledger.counted, strict=False):
                np.add.at(row, link, ledger.table(name).sum(axis=0))
        for _, message in sorted(self._last.items()):
            left = message.in_flight or [0] * len(message.link)
            for name, count in zip(message.link, left, strict=True):
                counts[-1, self._links[name]] = count
        return counts
