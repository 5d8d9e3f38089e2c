"""The network of links without any process: in whatever order slots are sent, their fates are the same."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bus import keys
from bus.messages import ChannelEvents
from bus.packets import Packet
from bus.plan import EstimatorPlan, Kind, LinkPlan, Plan, PlantPlan, StagePlan, TimingPlan
from channel.network import build_network

NAMES = ("a", "e1", "e10", "e2", "z")
NOWHERE = Kind("nowhere:Nothing")
BERNOULLI = "channel.impairments.bernoulli:Bernoulli"
GILBERT_ELLIOTT = "channel.impairments.gilbert_elliott:GilbertElliott"
BIAS = "channel.attacks.bias:Bias"

Edge = tuple[str, str]
Slot = tuple[str, int, int]
"""Who sends or receives, the step, and the round."""
Row = tuple[str, int, tuple[float, ...]]
"""A packet as it can be compared: source, sequence, values."""


def link_name(edge: Edge) -> str:
    return f"{edge[0]}->{edge[1]}"


def stage(
    label: str, kind: Kind, edges: Iterable[Edge], *, shared: bool = False, first: int = 0, last: int = 99
) -> StagePlan:
    streams = {link_name(edge): "medium" if shared else link_name(edge) for edge in edges}
    return StagePlan(label, kind, streams, label, TimingPlan(first, last))


def plan_of(
    edges: Sequence[Edge], stages: Sequence[StagePlan] = (), rounds: Mapping[str, int] | None = None
) -> Plan:
    """Return estimators that exchange over the edges; a stage stands where it has a stream."""
    links = tuple(
        LinkPlan(
            *edge,
            keys.EXCHANGE,
            tuple(placed.label for placed in stages if link_name(edge) in placed.streams),
        )
        for edge in edges
    )
    nodes = sorted({node for edge in edges for node in edge})
    estimators = tuple(EstimatorPlan(node, NOWHERE, (), {}, (rounds or {}).get(node, 1)) for node in nodes)
    plant = PlantPlan("plant", NOWHERE)
    return Plan("net", 5, 0, 8, 0.1, plant, (), estimators, tuple(stages), links)


@dataclass(frozen=True)
class Passed:
    """What came out of a network: inboxes and accounts by slot, each in the order in which it was whole."""

    inboxes: dict[Slot, list[Row]]
    accounts: dict[tuple[int, int], ChannelEvents]

    def fates(self, link: str) -> list[tuple[Any, ...]]:
        """Return all that was noted about one link."""
        noted = []
        for slot, account in sorted(self.accounts.items()):
            at = account.link.index(link)
            counts = (account.sent[at], account.lost[at], account.attacked[at], account.delivered[at])
            events = [event for event in events_of(account) if event[0] == link]
            noted.append((slot, counts, events))
        return noted


def events_of(account: ChannelEvents) -> list[tuple[Any, ...]]:
    return list(
        zip(
            account.event_link,
            account.event_stage,
            account.event_sequence,
            account.event_action,
            account.event_magnitude,
            strict=True,
        )
    )


def carry(plan: Plan, sent: Mapping[Slot, Sequence[Packet]], order: Sequence[str]) -> Passed:
    """Let each sender send its slots one after another, taking turns as the order says."""
    network = build_network(plan, keys.EXCHANGE)
    waiting = {name: sorted(slot for slot in sent if slot[0] == name) for name in network.sources}
    inboxes: dict[Slot, list[Row]] = {}
    accounts = {}
    for name in order:
        _, step, round_ = slot = waiting[name].pop(0)
        for receiver, packets, _ in network.transmit(name, step, round_, sent[slot]):
            assert (receiver, step, round_) not in inboxes, "an inbox is complete once"
            inboxes[receiver, step, round_] = [
                (packet.source, packet.sequence, tuple(packet.values.tolist())) for packet in packets
            ]
        happened = network.take_events(step, round_)
        account = happened and happened.message()
        if account is not None:
            assert (account.step, account.round) == (step, round_)
            accounts[step, round_] = account
    assert not any(waiting.values())
    return Passed(inboxes, accounts)


@dataclass(frozen=True)
class Case:
    plan: Plan
    edges: list[Edge]
    sent: dict[Slot, list[Packet]]
    orders: tuple[list[str], list[str]]


KINDS = st.one_of(
    st.builds(lambda loss: Kind(BERNOULLI, {"loss": loss}), st.sampled_from([0.0, 0.3, 1.0])),
    st.builds(
        lambda clock: Kind(GILBERT_ELLIOTT, {"failure": 0.4, "recovery": 0.5, "clock": clock}),
        st.sampled_from(["step", "slot", "packet"]),
    ),
    st.builds(lambda value: Kind(BIAS, {"value": value}), st.sampled_from([1.0, -3.0])),
)


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Draw a graph, stages on some of its links, what everybody sends, and two orders of sending it."""
    pairs = [(a, b) for a in NAMES for b in NAMES if a != b]
    edges = draw(st.lists(st.sampled_from(pairs), min_size=1, max_size=9, unique=True))
    stages = []
    for number, kind in enumerate(draw(st.lists(KINDS, max_size=3))):
        on = draw(st.lists(st.sampled_from(edges), min_size=1, unique=True))
        shared = draw(st.booleans()) and kind.parameters.get("clock", "step") == "step"
        first, last = sorted(draw(st.tuples(st.integers(0, 3), st.integers(0, 3))))
        stages.append(stage(f"stage{number}", kind, on, shared=shared, first=first, last=last))
    steps, rounds = draw(st.integers(1, 4)), draw(st.integers(1, 3))
    senders = sorted({source for source, _ in edges})
    sent = {
        (name, step, round_): draw_packets(draw, name, step, round_)
        for name in senders
        for step in range(steps)
        for round_ in range(rounds)
    }
    turns = [name for name, _, _ in sent]
    plan = plan_of(edges, stages, dict.fromkeys(NAMES, rounds))
    return Case(plan, edges, sent, (draw(st.permutations(turns)), draw(st.permutations(turns))))


def draw_packets(draw: st.DrawFn, name: str, step: int, round_: int) -> list[Packet]:
    begin = 100 * step + 10 * round_
    return [
        Packet(name, step, begin + number, keys.EXCHANGE, np.array([float(begin), float(number)]))
        for number in range(draw(st.integers(0, 2)))
    ]


@given(cases())
@settings(deadline=None)
def test_every_inbox_is_complete_once_and_in_the_order_of_its_sources_names(case: Case) -> None:
    passed = carry(case.plan, case.sent, case.orders[0])
    receivers = {receiver for _, receiver in case.edges}
    slots = {(step, round_) for _, step, round_ in case.sent}
    assert set(passed.inboxes) == {(receiver, *slot) for receiver in receivers for slot in slots}
    for (receiver, step, round_), rows in passed.inboxes.items():
        expected = [
            (name, packet.sequence)
            for name in sorted(source for source, heard_by in case.edges if heard_by == receiver)
            for packet in case.sent[name, step, round_]
        ]
        arrived = [(source, sequence) for source, sequence, _ in rows]
        assert sorted(arrived) == sorted(packet for packet in expected if packet in arrived)
        assert [source for source, _ in arrived] == sorted(source for source, _ in arrived)
        if not case.plan.stages:
            assert arrived == expected


@given(cases())
@settings(deadline=None)
def test_on_every_link_and_in_every_slot_what_was_sent_was_delivered_or_lost(case: Case) -> None:
    passed = carry(case.plan, case.sent, case.orders[0])
    assert set(passed.accounts) == {(step, round_) for _, step, round_ in case.sent}
    for (step, round_), account in passed.accounts.items():
        assert sorted(account.link) == sorted(map(link_name, case.edges))
        for number, link in enumerate(account.link):
            source, receiver = link.split("->")
            arrived = [row for row in passed.inboxes[receiver, step, round_] if row[0] == source]
            assert account.sent[number] == len(case.sent[source, step, round_])
            assert account.delivered[number] == len(arrived)
            assert account.sent[number] == account.delivered[number] + account.lost[number]
        lost = [event for event in events_of(account) if event[3] == "lost"]
        assert len(lost) == sum(account.lost)
        assert len(set(lost)) == len(lost), "a packet is lost once"


@given(cases())
@settings(deadline=None)
def test_the_order_of_the_senders_changes_nothing(case: Case) -> None:
    one, another = (carry(case.plan, case.sent, order) for order in case.orders)
    assert one == another


@given(cases(), st.data())
@settings(deadline=None)
def test_the_fates_on_a_link_do_not_depend_on_which_other_links_there_are(
    case: Case, data: st.DataObject
) -> None:
    link = data.draw(st.sampled_from(case.edges))
    others = data.draw(st.lists(st.sampled_from(case.edges), unique=True))
    left = [edge for edge in case.edges if edge == link or edge in others]
    names = set(map(link_name, left))
    stages = [
        replace(placed, streams={name: of for name, of in placed.streams.items() if name in names})
        for placed in case.plan.stages
    ]
    fewer = plan_of(left, stages, {own.name: own.rounds for own in case.plan.estimators})
    senders = {source for source, _ in left}
    sent = {slot: packets for slot, packets in case.sent.items() if slot[0] in senders}
    order = [name for name in case.orders[0] if name in senders]
    before, after = carry(case.plan, case.sent, case.orders[0]), carry(fewer, sent, order)
    assert before.fates(link_name(link)) == after.fates(link_name(link))
    source, receiver = link
    for slot, rows in after.inboxes.items():
        if slot[0] == receiver:
            own = [row for row in rows if row[0] == source]
            assert own == [row for row in before.inboxes[slot] if row[0] == source]


def steady(name: str, steps: int, rounds: int = 1) -> dict[Slot, list[Packet]]:
    """Return one packet a slot."""
    return {
        (name, step, round_): [Packet(name, step, rounds * step + round_, keys.EXCHANGE, np.zeros(2))]
        for step in range(steps)
        for round_ in range(rounds)
    }


def actions(passed: Passed) -> list[tuple[int, str, str]]:
    """Return (step, stage, action) of everything that was done, in the order of the accounts."""
    return [
        (account.step, event[1], event[3])
        for _, account in sorted(passed.accounts.items())
        for event in events_of(account)
    ]


def test_a_stage_acts_from_its_first_step_to_its_last_both_included() -> None:
    edges = [("a", "z")]
    for first, last in ((2, 4), (3, 3), (0, 6)):
        bias = stage("bias", Kind(BIAS, {"value": 1.0}), edges, first=first, last=last)
        passed = carry(plan_of(edges, [bias]), steady("a", 7), ["a"] * 7)
        assert [step for step, _, _ in actions(passed)] == list(range(first, last + 1))


def test_stages_act_in_their_order_on_the_link() -> None:
    edges = [("a", "z")]
    bias = stage("bias", Kind(BIAS, {"value": 1.0}), edges)
    loss = stage("loss", Kind(BERNOULLI, {"loss": 1.0}), edges)
    attack_first = carry(plan_of(edges, [bias, loss]), steady("a", 1), ["a"])
    assert actions(attack_first) == [(0, "bias", "attacked"), (0, "loss", "lost")]
    assert (attack_first.accounts[0, 0].attacked, attack_first.accounts[0, 0].lost) == ([1], [1])
    loss_first = carry(plan_of(edges, [loss, bias]), steady("a", 1), ["a"])
    assert actions(loss_first) == [(0, "loss", "lost")]


def test_an_inbox_is_untouched_unless_it_holds_what_a_stage_made() -> None:
    edges = [("a", "z"), ("b", "z")]
    loss = stage("loss", Kind(BERNOULLI, {"loss": 1.0}), [("a", "z")], first=1, last=2)
    bias = stage("bias", Kind(BIAS, {"value": 1.0}), [("b", "z")], first=2, last=3)
    network = build_network(plan_of(edges, [loss, bias]), keys.EXCHANGE)
    found = []
    for step in range(5):
        for name in "ab":
            packet = Packet(name, step, step, keys.EXCHANGE, np.zeros(2))
            found += network.transmit(name, step, 0, [packet])
    told = [([packet.source for packet in packets], untouched) for _, packets, untouched in found]
    assert told == [
        (["a", "b"], True),
        (["b"], True),
        (["b"], False),
        (["a", "b"], False),
        (["a", "b"], True),
    ]


def test_a_packet_that_two_stages_falsify_is_one_attacked_packet() -> None:
    edges = [("a", "z")]
    stages = [stage(label, Kind(BIAS, {"value": 1.0}), edges) for label in ("first", "second")]
    passed = carry(plan_of(edges, stages), steady("a", 1), ["a"])
    assert actions(passed) == [(0, "first", "attacked"), (0, "second", "attacked")]
    assert passed.accounts[0, 0].attacked == [1]
    assert passed.inboxes["z", 0, 0] == [("a", 0, (2.0, 2.0))]


def test_all_rounds_of_a_step_meet_the_same_state_of_a_chain_that_steps_drive() -> None:
    edges = [("a", "z")]
    burst = stage("burst", Kind(GILBERT_ELLIOTT, {"failure": 0.5, "recovery": 0.5}), edges)
    passed = carry(plan_of(edges, [burst], {"a": 3}), steady("a", 8, rounds=3), ["a"] * 24)
    lost = defaultdict(set)
    for (step, _), account in passed.accounts.items():
        lost[step].add(account.lost[0])
    assert all(len(fates) == 1 for fates in lost.values())
    assert {0, 1} == set.union(*lost.values())


def test_nodes_with_fewer_rounds_have_no_part_in_the_later_ones() -> None:
    edges = [("a", "e1"), ("e1", "a"), ("e2", "z"), ("z", "e2")]
    rounds = {"a": 2, "e1": 2, "e2": 1, "z": 1}
    sent = {slot: packets for name in rounds for slot, packets in steady(name, 1, rounds[name]).items()}
    passed = carry(plan_of(edges, (), rounds), sent, ["a", "e1", "a", "e1", "e2", "z"])
    assert sorted(passed.accounts[0, 0].link) == ["a->e1", "e1->a", "e2->z", "z->e2"]
    assert sorted(passed.accounts[0, 1].link) == ["a->e1", "e1->a"]
    assert {slot for slot in passed.inboxes if slot[2] == 1} == {("a", 0, 1), ("e1", 0, 1)}
