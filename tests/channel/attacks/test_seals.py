"""Which false packets pass the receiver's check: by seal, by keys, and by who forges. Accounts add up."""

from __future__ import annotations

import numpy as np
import pytest

from bus import keys
from bus.integrity import seal_of
from bus.messages import ChannelEvents
from bus.packets import Packet
from bus.plan import EstimatorPlan, Kind, LinkPlan, Plan, PlantPlan, SensorPlan, StagePlan, TimingPlan
from channel.attacks.laws import Box, ValueLaw
from channel.network import build_network
from orchestrator.registry import BUILT_IN

NOWHERE = Kind("nowhere:Nothing")
LAW = ValueLaw(box=Box(5.0, 6.0))
KINDS = {
    "bias": {"value": 1.0},
    "drift": {"rate": 1.0},
    "converging_bias": {"target": 1.0, "probability": 1.0},
    "scaling": {"low": 0.5, "high": 0.6},
    "noise": {"std": 1.0},
    "constant": {"value": -3.0},
    "hold": {},
    "stale": {"age": 2},
    "series": {"values": [[1.0]], "after": "hold"},
    "flip": {},
    "substitution": {"probability": 1.0, "values": LAW},
    "injection": {"count": 2, "values": LAW},
    "replay": {"capture": [0, 2]},
    "sybil": {"identity": "s2", "values": LAW},
    "babbling": {"count": 2, "spread": 1.0},
    "byzantine": {"spread": 1.0},
}
INSIDERS = {"babbling", "byzantine"}
STEPS, FIRST = 10, 4


def run(kind: str, integrity: str | None, holds_keys: bool) -> tuple[list[ChannelEvents], list[Packet]]:
    """Return the accounts of ten steps of two sensors and one estimator, and all packets that arrived."""
    timing = TimingPlan(FIRST, STEPS - 1)
    attack = Kind(BUILT_IN["attacks"][kind], KINDS[kind])
    stage = StagePlan("attack", attack, {"s1->e1": "s1->e1"}, "attack", timing, holds_keys=holds_keys)
    plan = Plan(
        *("seals", 3, 0, STEPS, 0.1, PlantPlan("plant", NOWHERE)),
        tuple(SensorPlan(name, NOWHERE) for name in ("s1", "s2")),
        (EstimatorPlan("e1", NOWHERE, ("s1", "s2"), {}, 0),),
        (stage,),
        tuple(
            LinkPlan(name, "e1", keys.MEASUREMENT, labels)
            for name, labels in (("s1", ("attack",)), ("s2", ()))
        ),
        integrity={} if integrity is None else {"s1": integrity, "s2": integrity},
    )
    network = build_network(plan, keys.MEASUREMENT)
    accounts, arrived = [], []
    for step in range(STEPS):
        for name in ("s1", "s2"):
            genuine = Packet(name, step, step, keys.MEASUREMENT, np.array([1.0 + step, 10.0]))
            seal = seal_of(plan, name)
            if seal is not None:
                genuine = replace_check(genuine, seal(genuine))
            for _, packets, _ in network.transmit(name, step, 0, [genuine]):
                arrived += packets
        happened = network.take_events(step, 0)
        account = happened and happened.message()
        assert account is not None
        accounts.append(account)
    return accounts, arrived


def replace_check(packet: Packet, check: int) -> Packet:
    return Packet(packet.source, packet.sent_step, packet.sequence, packet.kind, packet.values, check)


def total(accounts: list[ChannelEvents], name: str) -> int:
    return sum(sum(getattr(account, name)) for account in accounts)


def test_every_attack_on_links_has_a_case_here() -> None:
    written_here = {
        name for name, reference in BUILT_IN["attacks"].items() if reference.startswith("channel.attacks.")
    }
    assert set(KINDS) <= written_here


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("integrity", "holds_keys"), [(None, False), ("crc", False), ("mac", True)])
def test_false_packets_pass_where_the_adversary_can_seal_them(kind, integrity, holds_keys):
    accounts, _ = run(kind, integrity, holds_keys)
    assert total(accounts, "refused") == 0
    assert total(accounts, "attacked") + total(accounts, "injected") > 0


@pytest.mark.parametrize("kind", KINDS)
def test_without_keys_a_mac_refuses_every_false_packet_but_an_insiders(kind):
    accounts, _ = run(kind, "mac", False)
    false = total(accounts, "attacked") + total(accounts, "injected")
    assert total(accounts, "refused") == (0 if kind in INSIDERS else false)


def test_a_replay_with_old_headers_passes_a_mac(monkeypatch):
    monkeypatch.setitem(KINDS, "replay", {"capture": [0, 2], "rewrite": False})
    accounts, arrived = run("replay", "mac", False)
    assert total(accounts, "refused") == 0
    assert [packet.sequence for packet in arrived if packet.source == "s1"] == [0, 1, 2, 3, 0, 1, 2, 0, 1, 2]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("integrity", [None, "mac"])
def test_accounts_add_up_in_every_slot(kind, integrity):
    accounts, arrived = run(kind, integrity, False)
    for account in accounts:
        counted = [
            getattr(account, name) or [0, 0] for name in ("injected", "duplicated", "refused", "in_flight")
        ]
        for at in range(len(account.link)):
            injected, duplicated, refused, in_flight = (column[at] for column in counted)
            made = account.sent[at] + injected + duplicated
            assert made == account.delivered[at] + account.lost[at] + refused + in_flight
    assert len(arrived) == total(accounts, "delivered") + total(accounts, "refused")
