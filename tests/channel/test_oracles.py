"""What the channel tells an estimator that was granted an oracle, and that nobody else can say it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from bus import keys
from bus.messages import ChannelEvents
from bus.packets import ORACLE, Packet
from bus.plan import EstimatorPlan, Kind, LinkPlan, Plan, PlantPlan, SensorPlan, StagePlan, TimingPlan
from channel.contract import Lane, Ledger, Placement, Slot
from channel.network import PhaseNetwork, build_network

NOWHERE = Kind("nowhere:Nothing")
CONVERGING = Kind("channel.attacks.converging_bias:ConvergingBias", {"target": 0.5})
LOSS = Kind("channel.impairments.bernoulli:Bernoulli", {"loss": 1.0})
STEPS = 60
LINKS = tuple(f"{sensor}->{estimator}" for estimator in ("e1", "e2") for sensor in ("s1", "s2"))


class Babbler:
    """A stage that speaks as an oracle, which is nobody's part to do."""

    open_loop = False

    def __init__(self, placement: Placement) -> None:
        self._placement = placement

    def lane(self, link: str) -> Lane:
        return _Babbling(self._placement, link)


class _Babbling(Lane):
    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        word = self.placement.forged(packets[0], np.array([7.0, 7.0]), kind=ORACLE)
        ledger.injected(self.link, self.label, word)
        return [*packets, word]


def stage(label: str, kind: Kind, first: int = 0, last: int = STEPS - 1) -> StagePlan:
    return StagePlan(label, kind, {link: link[:2] for link in LINKS}, label, TimingPlan(first, last))


def plan_of(*stages: StagePlan, oracles: tuple[str, ...] = ("bias",)) -> Plan:
    """Two estimators on the same two sensors; the first one is told."""
    labels = tuple(placed.label for placed in stages)
    links = tuple(LinkPlan(link[:2], link[4:], keys.MEASUREMENT, labels) for link in LINKS)
    told = EstimatorPlan("e1", NOWHERE, ("s1", "s2"), {}, 0, oracles=oracles)
    honest = replace(told, name="e2", oracles=())
    sensors = (SensorPlan("s1", NOWHERE), SensorPlan("s2", NOWHERE))
    return Plan("p", 3, 0, STEPS, 1.0, PlantPlan("plant", NOWHERE), sensors, (told, honest), stages, links)


def passed(
    network: PhaseNetwork, step: int, order: Sequence[str] = ("s1", "s2")
) -> tuple[dict[str, list[Packet]], ChannelEvents]:
    """Send one packet of two values from each sensor; return the inboxes, and the account."""
    inboxes: dict[str, list[Packet]] = {}
    for source in order:
        packet = Packet(source, step, step, keys.MEASUREMENT, np.array([1.0, 2.0]))
        inboxes.update({to: arrived for to, arrived, _ in network.transmit(source, step, 0, [packet])})
    events = network.take_events(step, 0)
    assert events is not None
    return inboxes, events.message()


def words(packets: Sequence[Packet]) -> dict[str, list[float]]:
    return {packet.source: packet.values.tolist() for packet in packets if packet.kind == ORACLE}


def test_it_is_told_what_the_attack_adds_whether_it_occurs_or_not_and_nobody_else_is() -> None:
    network = build_network(plan_of(stage("bias", CONVERGING)), keys.MEASUREMENT)
    occurred = 0
    for step in range(STEPS):
        inboxes, events = passed(network, step)
        gamma = 0.5 * (1.0 - 0.9**step)
        told = words(inboxes["e1"])
        assert list(told) == ["s1", "s2"]
        np.testing.assert_allclose(list(told.values()), gamma, atol=1e-12)
        assert words(inboxes["e2"]) == {}
        occurred += sum(events.attacked[:2])
        assert events.delivered == [1, 1, 1, 1], "an oracle's word is no delivery"
        assert [packet.kind for packet in inboxes["e1"]] == [keys.MEASUREMENT] * 2 + [ORACLE] * 2
    assert 30 < occurred < 90, "half of 120"


def test_the_privilege_changes_nothing_that_anybody_receives_besides() -> None:
    told, honest = (
        build_network(plan_of(stage("bias", CONVERGING), oracles=oracles), keys.MEASUREMENT)
        for oracles in (("bias",), ())
    )
    for step in range(STEPS):
        (one, account), (other, same_account) = passed(told, step), passed(honest, step)
        assert account == same_account
        for name, packets in other.items():
            said = [packet for packet in one[name] if packet.kind != ORACLE]
            assert [p.values.tolist() for p in said] == [p.values.tolist() for p in packets]


def test_the_order_of_the_senders_changes_nothing() -> None:
    one, other = (build_network(plan_of(stage("bias", CONVERGING)), keys.MEASUREMENT) for _ in range(2))
    for step in range(5):
        here, there = passed(one, step)[0]["e1"], passed(other, step, ("s2", "s1"))[0]["e1"]
        assert [(p.source, p.kind, p.values.tolist()) for p in here] == [
            (p.source, p.kind, p.values.tolist()) for p in there
        ]


def test_outside_the_window_and_of_a_silent_sensor_there_is_nothing_to_tell() -> None:
    network = build_network(plan_of(stage("bias", CONVERGING, first=3, last=4)), keys.MEASUREMENT)
    told = [words(passed(network, step)[0]["e1"]) for step in range(6)]
    assert [bool(each) for each in told] == [False, False, False, True, True, False]
    assert told[3]["s1"] == [0.0, 0.0], "gamma begins with the window"
    silent = build_network(plan_of(stage("bias", CONVERGING)), keys.MEASUREMENT)
    inboxes = [entry for source in ("s1", "s2") for entry in silent.transmit(source, 0, 0, [])]
    assert inboxes == [("e1", [], True), ("e2", [], True)]


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        (Kind("channel.attacks.bias:Bias", {"value": [4.0], "components": [1]}), [0.0, 4.0]),
        (Kind("channel.attacks.drift:Drift", {"rate": [0.5, -1.0]}), [1.5, -3.0]),
        (Kind("channel.attacks.constant:Constant", {"value": 5.0}), [4.0, 3.0]),
    ],
)
def test_what_is_told_is_what_is_added(kind: Kind, expected: list[float]) -> None:
    inboxes, _ = passed(build_network(plan_of(stage("bias", kind)), keys.MEASUREMENT), 2)
    assert words(inboxes["e1"]) == {"s1": expected, "s2": expected}
    falsified = [packet.values - np.array([1.0, 2.0]) for packet in inboxes["e2"]]
    np.testing.assert_allclose(falsified, [expected, expected], atol=1e-12)


def test_of_two_attacks_that_it_is_told_of_it_hears_the_sum_and_of_another_nothing() -> None:
    first = stage("first", Kind("channel.attacks.bias:Bias", {"value": 1.0}))
    second = stage("second", Kind("channel.attacks.constant:Constant", {"value": 9.0}))
    both = build_network(plan_of(first, second, oracles=("first", "second")), keys.MEASUREMENT)
    assert words(passed(both, 0)[0]["e1"])["s1"] == [8.0, 7.0]
    one = build_network(plan_of(first, second, oracles=("first",)), keys.MEASUREMENT)
    assert words(passed(one, 0)[0]["e1"])["s1"] == [1.0, 1.0]


def test_a_lost_packet_is_told_of_and_the_word_is_not_lost() -> None:
    network = build_network(plan_of(stage("bias", CONVERGING), stage("loss", LOSS)), keys.MEASUREMENT)
    inboxes, events = passed(network, 1)
    assert [packet.kind for packet in inboxes["e1"]] == [ORACLE, ORACLE]
    assert (events.delivered, events.lost) == ([0] * 4, [1] * 4)


def test_a_stage_that_speaks_as_an_oracle_is_refused_and_accounted_for() -> None:
    babbling = stage("babble", Kind("tests.channel.test_oracles:Babbler"))
    inboxes, events = passed(build_network(plan_of(babbling, oracles=()), keys.MEASUREMENT), 0)
    assert all(packet.kind == keys.MEASUREMENT for packets in inboxes.values() for packet in packets)
    assert (events.delivered, events.injected, events.refused) == ([1] * 4, [1] * 4, [1] * 4)
