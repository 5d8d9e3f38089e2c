"""Whatever stages stand on the links, in whatever order: no packet comes or goes without being accounted for.

A kind that is not in `KINDS` fails `test_every_registered_kind_is_tried`: add a row for it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from bus import keys
from bus.integrity import seal_of
from bus.kinds import load_class
from bus.messages import ChannelEvents, encode
from bus.packets import Packet, inbox
from bus.plan import EstimatorPlan, Kind, LinkPlan, Plan, PlantPlan, StagePlan, TimingPlan
from channel.network import build_network
from orchestrator.registry import BUILT_IN

NAMES = ("a", "b", "c", "d")
STEPS = 6
PAYLOAD = 2

chance = st.sampled_from([0.0, 0.3, 1.0])
some = st.sampled_from([0.0, 0.7])

KINDS: Mapping[str, st.SearchStrategy[dict[str, Any]]] = {
    "perfect": st.just({}),
    "bernoulli": st.fixed_dictionaries({"loss": chance}, optional={"correlation": some}),
    "gilbert_elliott": st.fixed_dictionaries(
        {"failure": chance, "recovery": chance},
        optional={"clock": st.sampled_from(["step", "slot", "packet"]), "loss_good": chance},
    ),
    "outage": st.fixed_dictionaries({"windows": st.sampled_from([[[0, 1]], [[2, 2], [4, 5]]])}),
    "jammer": st.fixed_dictionaries(
        {"budget": st.sampled_from([1.0, 3.0])},
        optional={"probability": chance, "recharge": some, "loss": chance},
    ),
    "delay": st.fixed_dictionaries(
        {"delay": st.sampled_from([0.0, 1.5, 4.0])},
        optional={
            "jitter": st.sampled_from([0.0, 2.0]),
            "distribution": st.sampled_from(["uniform", "normal", "pareto"]),
            "correlation": some,
            "reorder": chance,
        },
    ),
    "reorder": st.fixed_dictionaries({"probability": chance}, optional={"hold": st.integers(1, 4)}),
    "duplicate": st.fixed_dictionaries({"probability": chance}),
    "corrupt": st.fixed_dictionaries({"probability": chance}, optional={"bits": st.integers(1, 5)}),
    "rate": st.fixed_dictionaries(
        {"rate": st.sampled_from([0.4, 1.0, 2.5])}, optional={"limit": st.integers(0, 3)}
    ),
    "quantise": st.fixed_dictionaries({"step": st.sampled_from([0.1, 5.0])}),
    "saturate": st.fixed_dictionaries({"low": st.just(-0.5)}, optional={"high": st.just(0.5)}),
    "bias": st.fixed_dictionaries({"value": st.sampled_from([1.0, -3.0])}),
}
"""The parameters of each kind, for payloads of two values."""

NOT_SHARED = {"rate"}
"""Kinds that refuse links of one stream."""

REFERENCES = {**BUILT_IN["impairments"], **BUILT_IN["attacks"]}


def test_every_registered_kind_is_tried() -> None:
    """Those that need to know a model are tried on the links of one, in files of their own."""
    knowing = {name for name, reference in REFERENCES.items() if hasattr(load_class(reference), "needs")}
    assert set(KINDS) == set(REFERENCES) - knowing


@dataclass(frozen=True)
class Case:
    plan: Plan
    sent: dict[tuple[str, int, int], list[Packet]]
    orders: tuple[list[str], list[str]]


def link_name(edge: tuple[str, str]) -> str:
    return f"{edge[0]}->{edge[1]}"


@st.composite
def stages(draw: st.DrawFn, label: str, edges: Sequence[tuple[str, str]]) -> StagePlan:
    """Draw a stage: its kind, the links it stands on, whether they share a stream, and when it acts."""
    name = draw(st.sampled_from(sorted(KINDS)))
    parameters = draw(KINDS[name])
    on = draw(st.lists(st.sampled_from(edges), min_size=1, unique=True))
    may_share = name not in NOT_SHARED and parameters.get("clock", "step") == "step"
    shared = may_share and draw(st.booleans())
    first, last = sorted(draw(st.tuples(st.integers(0, STEPS - 1), st.integers(0, STEPS - 1))))
    when = draw(st.sampled_from([None, Kind("bus.schedules:Periodic", {"every": 3, "steps_on": 2})]))
    timing = TimingPlan(first, last, when, label, "when") if draw(st.booleans()) else TimingPlan(0, STEPS - 1)
    streams = {link_name(edge): "medium" if shared else link_name(edge) for edge in on}
    return StagePlan(label, Kind(REFERENCES[name], parameters), streams, label, timing)


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Draw a graph, up to five stages, seals, what everybody sends, and two orders of sending it."""
    pairs = [(a, b) for a in NAMES for b in NAMES if a != b]
    edges = draw(st.lists(st.sampled_from(pairs), min_size=1, max_size=5, unique=True))
    placed = [draw(stages(f"stage{number}", edges)) for number in range(draw(st.integers(1, 5)))]
    rounds = draw(st.integers(1, 2))
    integrity = draw(st.dictionaries(st.sampled_from(NAMES), st.sampled_from(["crc", "mac"])))
    plan = plan_of(edges, placed, rounds, integrity)
    senders = sorted({source for source, _ in edges})
    sent = {
        (name, step, round_): packets_of(plan, name, step, round_, draw(st.integers(0, 2)))
        for name in senders
        for step in range(STEPS)
        for round_ in range(rounds)
    }
    turns = [name for name, _, _ in sent]
    return Case(plan, sent, (draw(st.permutations(turns)), draw(st.permutations(turns))))


def plan_of(
    edges: Iterable[tuple[str, str]], placed: Sequence[StagePlan], rounds: int, integrity: Mapping[str, str]
) -> Plan:
    links = tuple(
        LinkPlan(
            *edge, keys.EXCHANGE, tuple(stage.label for stage in placed if link_name(edge) in stage.streams)
        )
        for edge in edges
    )
    nowhere = Kind("nowhere:Nothing")
    estimators = tuple(EstimatorPlan(name, nowhere, (), {}, rounds) for name in NAMES)
    plant = PlantPlan("plant", nowhere)
    return Plan(
        "net", 5, 0, STEPS, 0.1, plant, (), estimators, tuple(placed), links, integrity=dict(integrity)
    )


def packets_of(plan: Plan, name: str, step: int, round_: int, count: int) -> list[Packet]:
    """Return packets as the node would have sealed them."""
    seal = seal_of(plan, name)
    begin = 100 * step + 10 * round_
    packets = [
        Packet(name, step, begin + number, keys.EXCHANGE, np.linspace(0.3, step + number, PAYLOAD))
        for number in range(count)
    ]
    return packets if seal is None else [replace(packet, check=seal(packet)) for packet in packets]


def carry(case: Case, order: Sequence[str]) -> tuple[dict[tuple[str, int, int], bytes], list[ChannelEvents]]:
    """Let each sender send its slots in turn; return inboxes and accounts as they travel."""
    network = build_network(case.plan, keys.EXCHANGE)
    waiting = {name: sorted(slot for slot in case.sent if slot[0] == name) for name in network.sources}
    inboxes, accounts = {}, []
    for name in order:
        _, step, round_ = slot = waiting[name].pop(0)
        for receiver, packets in network.transmit(name, step, round_, case.sent[slot]):
            inboxes[receiver, step, round_] = encode(inbox(step, 0.0, round_, packets))
        account = network.take_events(step, round_)
        if account is not None:
            accounts.append(account)
    return inboxes, sorted(accounts, key=lambda account: (account.step, account.round))


def balance(accounts: Sequence[ChannelEvents]) -> None:
    """Check in every slot of every link that what came in went out, was lost, or is on its way."""
    surplus: Counter[str] = Counter()
    for account in accounts:
        nothing = [0] * len(account.link)
        columns = zip(
            account.link,
            account.sent,
            account.injected or nothing,
            account.duplicated or nothing,
            account.delivered,
            account.lost,
            account.refused or nothing,
            account.in_flight or nothing,
            strict=True,
        )
        for link, sent, injected, duplicated, delivered, lost, refused, in_flight in columns:
            surplus[link] += sent + injected + duplicated - delivered - lost - refused
            assert min(sent, injected, duplicated, delivered, lost, refused, in_flight) >= 0
            assert surplus[link] == in_flight, (link, account.step, account.round)


@given(cases())
@settings(deadline=None, max_examples=120, suppress_health_check=[HealthCheck.too_slow])
def test_every_packet_is_accounted_for_on_every_link_and_in_every_slot(case: Case) -> None:
    _, accounts = carry(case, case.orders[0])
    assert [(account.step, account.round) for account in accounts] == sorted(
        {(step, round_) for _, step, round_ in case.sent}
    )
    balance(accounts)


@given(cases())
@settings(deadline=None, max_examples=80, suppress_health_check=[HealthCheck.too_slow])
def test_the_order_in_which_senders_send_changes_nothing(case: Case) -> None:
    one, another = (carry(case, order) for order in case.orders)
    assert one == another


@given(cases())
@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])
def test_leaving_out_the_slots_that_lanes_are_quiet_in_changes_nothing(case: Case) -> None:
    sparing = carry(case, case.orders[0])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("channel.network._Placed.ahead", lambda placed, step: step)
        assert carry(case, case.orders[0]) == sparing
