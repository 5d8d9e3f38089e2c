"""The network between the nodes: links with their stages in order. Pure: slots in, inboxes and events out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from bus.kinds import load_class
from bus.messages import ChannelEvents
from bus.packets import Packet
from bus.plan import LinkPlan, Plan, StagePlan
from bus.random_streams import random_stream
from channel.contract import ATTACKED, LOST, Ledger, Placement, Stage


def build_stage(plan: Plan, stage: StagePlan) -> Stage:
    """Construct a stage with its random streams; raises ValueError when its parameters make no sense."""
    generators = {
        stream: random_stream(plan.seed, plan.trial, stream, stage.purpose)
        for stream in dict.fromkeys(stage.streams.values())
    }
    placement = Placement(stage.label, stage.streams, generators)
    built: Stage = load_class(stage.kind.reference)(placement, **stage.kind.parameters)
    return built


class _Link:
    """One link's stages, each with its window of steps."""

    __slots__ = ("destination", "name", "number", "stages")

    def __init__(self, number: int, plan: LinkPlan, stages: Mapping[str, tuple[StagePlan, Stage]]) -> None:
        self.number = number
        self.name = plan.name
        self.destination = plan.destination
        placed = [stages[label] for label in plan.stages]
        self.stages = [(stage_plan.first, stage_plan.last, stage.apply) for stage_plan, stage in placed]


class _Account:
    """What happened in one phase and round of one step, filled link by link."""

    __slots__ = ("delivered", "ledger", "left", "sent")

    def __init__(self, links: int) -> None:
        self.left = links
        self.sent = [0] * links
        self.delivered = [0] * links
        self.ledger = Ledger()


class PhaseNetwork:
    """All links that carry one stream.

    Slots may arrive in any order over senders; an inbox is complete when the slot of every link into its
    receiver is in, and the events of a phase when all inboxes are. Senders may differ in their number of
    exchange rounds: links stand sorted by it, the most first, so that the links of a round are the first of
    the list.
    """

    def __init__(self, plan: Plan, stream: str, stages: Mapping[str, tuple[StagePlan, Stage]]) -> None:
        self._period_s = plan.period_s
        rounds = {estimator.name: estimator.rounds for estimator in plan.estimators}
        links = sorted(plan.links_of(stream), key=lambda link: -rounds.get(link.source, 1))
        self._names = [
            [link.name for link in links if rounds.get(link.source, 1) > round_]
            for round_ in range(max((rounds.get(link.source, 1) for link in links), default=0))
        ]
        self._numbers = {link.name: number for number, link in enumerate(links)}
        self._from: dict[str, list[_Link]] = {}
        for number, link in enumerate(links):
            self._from.setdefault(link.source, []).append(_Link(number, link, stages))
        self._in_degree = Counter(link.destination for link in links)
        self._inboxes: dict[tuple[str, int, int], dict[str, Sequence[Packet]]] = {}
        self._accounts: dict[tuple[int, int], _Account] = {}

    @property
    def sources(self) -> tuple[str, ...]:
        """The nodes that send on this stream."""
        return tuple(self._from)

    def transmit(
        self, source: str, step: int, round_: int, packets: Sequence[Packet]
    ) -> list[tuple[str, list[Packet]]]:
        """Pass a sender's slot over all its links; return the inboxes (receiver, packets) that it completed.

        Packets of an inbox stand in the order of their sources' names.
        """
        account = self._accounts.get((step, round_))
        if account is None:
            account = self._accounts[step, round_] = _Account(len(self._names[round_]))
        complete = []
        for link in self._from[source]:
            arrived = packets
            for first, last, apply in link.stages:
                if first <= step <= last:
                    arrived = apply(link.name, step, arrived, account.ledger)
            account.sent[link.number] = len(packets)
            account.delivered[link.number] = len(arrived)
            account.left -= 1
            inbox = (link.destination, step, round_)
            slots = self._inboxes.setdefault(inbox, {})
            slots[source] = arrived
            if len(slots) == self._in_degree[link.destination]:
                del self._inboxes[inbox]
                complete.append(
                    (link.destination, [packet for name in sorted(slots) for packet in slots[name]])
                )
        return complete

    def take_events(self, step: int, round_: int) -> ChannelEvents | None:
        """Return the events of a phase once every slot has passed, None before."""
        account = self._accounts[step, round_]
        if account.left:
            return None
        del self._accounts[step, round_]
        names = self._names[round_]
        lost = [0] * len(names)
        attacked = [0] * len(names)
        events = sorted(account.ledger.events, key=lambda event: self._numbers[event.link])
        for event in events:
            if event.action == LOST:
                lost[self._numbers[event.link]] += 1
        for link, _ in {(event.link, event.sequence) for event in events if event.action == ATTACKED}:
            attacked[self._numbers[link]] += 1
        return ChannelEvents(
            step=step,
            t=step * self._period_s,
            round=round_,
            link=names,
            sent=account.sent,
            lost=lost,
            attacked=attacked,
            delivered=account.delivered,
            event_link=[event.link for event in events],
            event_stage=[event.stage for event in events],
            event_sequence=[event.sequence for event in events],
            event_action=[event.action for event in events],
            event_magnitude=[event.magnitude for event in events],
        )


def build_network(plan: Plan, stream: str) -> PhaseNetwork:
    """Build the links of one stream with the stages that stand on them."""
    wanted = {label for link in plan.links_of(stream) for label in link.stages}
    stages = {
        stage.label: (stage, build_stage(plan, stage)) for stage in plan.stages if stage.label in wanted
    }
    return PhaseNetwork(plan, stream, stages)
