"""Whatever stages stand on the links, in whatever order: no packet comes or goes without being accounted for.

A kind that is not in `KINDS` fails `test_every_registered_kind_is_tried`: add a row for it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
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
from orchestrator.registry import BUILT_IN, Role, find_kind
from orchestrator.topology.parameters import fill, parameters_model, values

NAMES = ("a", "b", "c", "d")
STEPS = 6
PAYLOAD = 2

chance = st.sampled_from([0.0, 0.3, 1.0])
some = st.sampled_from([0.0, 0.7])
count = st.sampled_from([0, 2, {"poisson": 1.5}])
false_values = st.sampled_from(
    [
        {"box": {"low": [5.0, 5.0], "high": 6.0}},
        {"normal": {"std": 1.0}},
        {"near": {"spread": 1.0}},
        {"copied": {}},
    ]
)

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
    "drift": st.just({"rate": 1.0}),
    "converging_bias": st.just({"target": 1.0}),
    "scaling": st.just({"low": 0.5, "high": 0.6}),
    "noise": st.just({"std": 1.0}),
    "constant": st.just({"value": -3.0, "components": [1]}),
    "hold": st.just({}),
    "stale": st.fixed_dictionaries({"age": st.integers(1, 3)}),
    "series": st.fixed_dictionaries({"values": st.just([[1.0]])}, optional={"replace": st.booleans()}),
    "flip": st.fixed_dictionaries({"probability": chance}),
    "substitution": st.fixed_dictionaries({"probability": chance, "values": false_values}),
    "injection": st.fixed_dictionaries({"count": count, "values": false_values}),
    "replay": st.fixed_dictionaries({"capture": st.just([0, 0])}, optional={"rewrite": st.booleans()}),
    "sybil": st.fixed_dictionaries({"identity": st.just("ghost"), "count": count, "values": false_values}),
    "babbling": st.fixed_dictionaries({"count": count}, optional={"spread": some}),
    "byzantine": st.just({"spread": 1.0}),
}
"""The parameters of each kind as a topology states them, for payloads of two values."""

NOT_SHARED = {"rate", "byzantine"}
"""Kinds that refuse links of one stream."""

BEGIN_LATER = {"replay"}
"""Kinds that cannot act from step 0 on."""

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
def stages(draw: st.DrawFn, label: str, edges: Sequence[tuple[str, str]], kind: str | None) -> StagePlan:
    """Draw a stage: its kind, the links it stands on, whether they share a stream, and when it acts."""
    name = kind or draw(st.sampled_from(sorted(KINDS)))
    parameters = draw(KINDS[name])
    on = draw(st.lists(st.sampled_from(edges), min_size=1, unique=True))
    may_share = name not in NOT_SHARED and parameters.get("clock", "step") == "step"
    shared = may_share and draw(st.booleans())
    begins_later = name in BEGIN_LATER
    first, last = sorted(draw(st.tuples(*[st.integers(int(begins_later), STEPS - 1)] * 2)))
    when = draw(st.sampled_from([None, Kind("bus.schedules:Periodic", {"every": 3, "steps_on": 2})]))
    timing = TimingPlan(first, last, when, label, "when")
    if not begins_later and draw(st.booleans()):
        timing = TimingPlan(0, STEPS - 1)
    streams = {link_name(edge): "medium" if shared else link_name(edge) for edge in on}
    holds_keys = draw(st.booleans())
    return StagePlan(label, kind_of(name, parameters), streams, label, timing, holds_keys=holds_keys)


def kind_of(name: str, stated: dict[str, Any]) -> Kind:
    role: Role = "impairments" if name in BUILT_IN["impairments"] else "attacks"
    model = parameters_model(find_kind(role, name, Path(".")), role)
    return Kind(REFERENCES[name], values(fill(model, stated)))


@st.composite
def cases(draw: st.DrawFn, kind: str | None = None) -> Case:
    """Draw a graph, up to five stages, seals, what everybody sends, and two orders of sending it.

    The first stage is of the given kind, if one is given.
    """
    pairs = [(a, b) for a in NAMES for b in NAMES if a != b]
    edges = draw(st.lists(st.sampled_from(pairs), min_size=1, max_size=5, unique=True))
    kinds = [kind] + [None] * draw(st.integers(0, 4))
    placed = [draw(stages(f"stage{number}", edges, kind)) for number, kind in enumerate(kinds)]
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
        for receiver, packets, _ in network.transmit(name, step, round_, case.sent[slot]):
            inboxes[receiver, step, round_] = encode(inbox(step, 0.0, round_, packets))
        happened = network.take_events(step, round_)
        account = happened and happened.message()
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


@pytest.mark.parametrize("kind", sorted(KINDS))
@given(data=st.data())
@settings(deadline=None, max_examples=15, suppress_health_check=[HealthCheck.too_slow])
def test_every_packet_is_accounted_for_on_every_link_and_in_every_slot(
    kind: str, data: st.DataObject
) -> None:
    case = data.draw(cases(kind))
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
        patch.setattr("channel.link.PlacedLane.ahead", lambda placed, step: step)
        assert carry(case, case.orders[0]) == sparing
