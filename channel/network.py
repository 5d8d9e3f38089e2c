"""The network between the nodes: links with their stages in order. Pure: slots in, inboxes and events out."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence

from bus import keys
from bus.integrity import Forger, Gate
from bus.kinds import load_class
from bus.packets import ORACLE, Packet
from bus.plan import Plan, StagePlan
from bus.random_streams import random_stream
from bus.schedules import Timing
from channel.contract import (
    ATTACKED,
    DUPLICATED,
    INJECTED,
    LOST,
    Ledger,
    Placement,
    Slot,
    Stage,
)
from channel.draws import SteppedDraws, permutation
from channel.happened import IN_FLIGHT, REFUSED, Happened
from channel.link import Link

_COUNTED = (LOST, ATTACKED, INJECTED, DUPLICATED)
_COUNT_BYTES = array("q").itemsize


def build_stage(plan: Plan, stage: StagePlan) -> Stage:
    """Construct a stage with its random streams; raises ValueError when its parameters make no sense."""
    generators = {
        stream: random_stream(plan.seed, plan.trial, stream, stage.purpose)
        for stream in dict.fromkeys(stage.streams.values())
    }
    kind = load_class(stage.kind.reference)
    holds_keys = stage.holds_keys or getattr(kind, "acts_as_sender", False)
    placement = Placement(
        stage.label,
        stage.streams,
        generators,
        stage.timing.first,
        stage.timing.last,
        Forger(plan, holds_keys),
        stage.knowledge,
        {link.name: link.stream for link in plan.links if link.name in stage.streams},
    )
    built: Stage = kind(placement, **stage.kind.parameters)
    return built


class _Inbox:
    """The slots of one receiver in one round of a step, in the order of their sources' names.

    ``told`` holds, by the place of a slot, what the receiver is told of the attack on it.
    """

    __slots__ = ("has_impostors", "left", "slots", "told", "untouched")

    def __init__(self, links: int) -> None:
        self.left = links
        self.slots: list[Sequence[Packet]] = [()] * links
        self.has_impostors = False
        self.untouched = True
        self.told: dict[int, Packet] = {}


class _Account:
    """What happened in one phase and round of one step, filled link by link."""

    __slots__ = ("delivered", "in_flight", "inboxes", "ledger", "left", "refused", "sent")

    def __init__(self, links: int, in_degrees: Sequence[int]) -> None:
        self.left = links
        self.inboxes = [_Inbox(degree) for degree in in_degrees]
        self.sent = array("q", bytes(_COUNT_BYTES * links))
        self.delivered = array("q", bytes(_COUNT_BYTES * links))
        self.refused: dict[int, int] = {}
        self.in_flight: dict[int, int] = {}
        self.ledger = Ledger()


class PhaseNetwork:
    """All links that carry one stream.

    Slots may arrive in any order over senders; an inbox is complete when the slot of every link into its
    receiver is in, and the events of a phase when all inboxes are. Senders may differ in their number of
    exchange rounds: links stand sorted by it, the most first, so that the links of a round are the first of
    the list.
    """

    def __init__(self, plan: Plan, stream: str, stages: Mapping[str, tuple[Timing, Stage]]) -> None:
        self._period_s = plan.period_s
        self._plan = plan
        self._rounds = {estimator.name: estimator.rounds for estimator in plan.estimators}
        oracles = {estimator.name: estimator.oracles for estimator in plan.estimators}
        links = sorted(plan.links_of(stream), key=lambda link: -self._rounds.get(link.source, 1))
        self._names = [
            [link.name for link in links if self._rounds.get(link.source, 1) > round_]
            for round_ in range(max((self._rounds.get(link.source, 1) for link in links), default=0))
        ]
        self._numbers = {link.name: number for number, link in enumerate(links)}
        self._from: dict[str, list[Link]] = {}
        sources: dict[str, list[str]] = {}
        for link in sorted(links, key=lambda link: link.source):
            sources.setdefault(link.destination, []).append(link.source)
        receivers = {name: number for number, name in enumerate(sources)}
        for number, link in enumerate(links):
            place = sources[link.destination].index(link.source)
            told = oracles.get(link.destination, ()) if stream == keys.MEASUREMENT else ()
            one = Link(number, link, receivers[link.destination], place, stages, plan.steps - 1, told)
            self._from.setdefault(link.source, []).append(one)
        self._in_degrees = [len(names) for names in sources.values()]
        self._gates = {receiver: Gate(plan, names) for receiver, names in sources.items()}
        self._admitted: dict[str, tuple[Packet, bool]] = {}
        """A sender's last packet that was checked, and the verdict: it is the same for all who hear it."""
        self._orders: dict[str, SteppedDraws] = {}
        self._accounts: dict[tuple[int, int], _Account] = {}
        self._watchers: dict[str, list[Timing]] = {}
        for timing, _ in stages.values():
            if timing.watches:
                self._watchers.setdefault(timing.watches, []).append(timing)

    @property
    def rounds(self) -> int:
        """The most rounds that a sender has in a step."""
        return len(self._names)

    @property
    def sources(self) -> tuple[str, ...]:
        """The nodes that send on this stream."""
        return tuple(self._from)

    @property
    def watched(self) -> tuple[str, ...]:
        """The nodes that triggers of this stream's stages watch, sorted."""
        return tuple(sorted(self._watchers))

    def note(self, watched: str, step: int, values: Sequence[float]) -> None:
        """Tell the triggers what they watch."""
        for timing in self._watchers[watched]:
            timing.note(step, values)

    def transmit(
        self, source: str, step: int, round_: int, packets: Sequence[Packet]
    ) -> list[tuple[str, list[Packet], bool]]:
        """Pass a sender's slot over all its links; return the inboxes that it completed.

        An inbox is told as its receiver, the packets, and whether they are nothing but packets as they were
        sent, in the slot in which they were. Packets of an inbox stand in the order of their sources' names.
        Where stages made several of one source meet, their order is a draw, and betrays nothing.
        """
        account = self._accounts.get((step, round_))
        if account is None:
            account = self._accounts[step, round_] = _Account(len(self._names[round_]), self._in_degrees)
        ledger = account.ledger
        rounds = self._rounds.get(source, 1)
        slot = Slot(step, round_, step * rounds + round_)
        next_step = step + 1 if round_ + 1 == rounds else step
        sent, delivered, inboxes = account.sent, account.delivered, account.inboxes
        complete = []
        for link in self._from[source]:
            arrived = packets
            if link.quiet <= step:
                arrived = link.carry(slot, packets, ledger, next_step)
                held = sum([keeper.held for keeper in link.keepers])
                if held:
                    account.in_flight[link.number] = held
            else:
                for act in link.plain:
                    arrived = act(slot, arrived, ledger)
            inbox = inboxes[link.receiver]
            number = link.number
            sent[number] = len(packets)
            delivered[number] = len(arrived)
            if arrived is not packets:
                arrived = self._settle(link, slot, arrived, account, inbox)
            inbox.slots[link.place] = arrived
            if link.oracles:
                told = link.told(slot, packets)
                if told is not None:
                    inbox.told[link.place] = told
                    inbox.untouched = False
            inbox.left -= 1
            if not inbox.left:
                arrived = self._packets(link.destination, slot, inbox)
                complete.append((link.destination, arrived, inbox.untouched))
        account.left -= len(self._from[source])
        return complete

    def _settle(
        self, link: Link, slot: Slot, arrived: Sequence[Packet], account: _Account, inbox: _Inbox
    ) -> Sequence[Packet]:
        """Account for what the stages of a link made of a slot; return its packets in a drawn order.

        No stage speaks as an oracle: such a packet is refused here, for its receiver could not tell.
        """
        if not arrived:
            return arrived
        inbox.untouched = False
        genuine = [packet for packet in arrived if packet.kind != ORACLE]
        refused = len(arrived) - len(genuine)
        if refused:
            arrived = genuine
        for packet in arrived:
            packet.values.flags.writeable = False  # a receiver in this process may get it as it is
            if packet.source != link.source:
                inbox.has_impostors = True
                refused += not self._gates[link.destination].admits(packet)
                continue
            last = self._admitted.get(packet.source)
            if last is None or last[0] is not packet:
                admitted = self._gates[link.destination].admits(packet)
                last = self._admitted[packet.source] = (packet, admitted)
            refused += not last[1]
        if refused:
            account.refused[link.number] = refused
            account.delivered[link.number] -= refused
        return self._shuffled(link.name, slot, arrived) if len(arrived) > 1 else arrived

    def _shuffled(self, name: str, slot: Slot, packets: Sequence[Packet]) -> list[Packet]:
        """Return packets that met in a slot, sorted and then permuted by a draw of this name and slot."""
        draws = self._orders.get(name)
        if draws is None:
            generator = random_stream(self._plan.seed, self._plan.trial, name, "order")
            draws = self._orders[name] = SteppedDraws(generator)
        by_content = sorted(packets, key=lambda packet: (packet.sequence, packet.values.tolist()))
        return [by_content[index] for index in permutation(draws.at(slot.number), len(by_content))]

    def _packets(self, receiver: str, slot: Slot, inbox: _Inbox) -> list[Packet]:
        """Return the packets of a whole inbox; those that come in another's name stand among the genuine.

        What oracles tell the receiver stands behind them.
        """
        packets = [packet for packets in inbox.slots for packet in packets]
        if inbox.has_impostors:
            shuffled = self._shuffled(f"->{receiver}", slot, packets)
            packets = sorted(shuffled, key=lambda packet: packet.source)
        return packets + [inbox.told[place] for place in sorted(inbox.told)]

    def take_events(self, step: int, round_: int) -> Happened | None:
        """Return the events of a phase once every slot has passed, None before."""
        account = self._accounts[step, round_]
        if account.left:
            return None
        del self._accounts[step, round_]
        names, numbers = self._names[round_], self._numbers
        events = account.ledger.events
        counts: dict[str, dict[int, int]] = {action: {} for action in _COUNTED}
        if events:
            events.sort(key=lambda event: numbers[event[0]])
            attacked = set()
            for link, _, sequence, action, _ in events:
                if action == ATTACKED:
                    if (link, sequence) in attacked:
                        continue
                    attacked.add((link, sequence))
                count = counts.get(action)
                if count is not None:
                    number = numbers[link]
                    count[number] = count.get(number, 0) + 1
        counts |= {REFUSED: account.refused, IN_FLIGHT: account.in_flight}
        t = step * self._period_s
        return Happened(step, t, round_, names, account.sent, account.delivered, counts, events)


def build_network(plan: Plan, stream: str) -> PhaseNetwork:
    """Build the links of one stream with the stages that stand on them."""
    return build_networks(plan, (stream,))[stream]


def build_networks(plan: Plan, streams: Sequence[str]) -> dict[str, PhaseNetwork]:
    """Build the links of some streams; a stage that stands on links of several is one in all of them."""
    wanted = {label for stream in streams for link in plan.links_of(stream) for label in link.stages}
    stages = {
        stage.label: (Timing(plan, stage.timing), build_stage(plan, stage))
        for stage in plan.stages
        if stage.label in wanted
    }
    networks = {}
    for stream in streams:
        here = {label for link in plan.links_of(stream) for label in link.stages}
        mine = {label: stage for label, stage in stages.items() if label in here}
        networks[stream] = PhaseNetwork(plan, stream, mine)
    return networks
