"""Common random numbers: what an attack draws depends on nothing but its own address and the slot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bus import keys
from bus.packets import Packet
from bus.plan import EstimatorPlan, Kind, LinkPlan, Plan, PlantPlan, SensorPlan, StagePlan, TimingPlan
from channel.network import build_network
from orchestrator.registry import BUILT_IN, find_kind
from orchestrator.topology.parameters import fill, parameters_model, values

NOWHERE = Kind("nowhere:Nothing")
BOX = {"box": {"low": [5.0, 5.0], "high": 6.0}}
OPEN_LOOP = {
    "bias": {"value": 1.0},
    "drift": {"rate": 1.0},
    "converging_bias": {"target": 1.0},
    "scaling": {"low": 0.5, "high": 0.6},
    "noise": {"std": 1.0},
    "constant": {"value": -3.0},
    "series": {"values": [[1.0]], "after": "hold"},
    "flip": {"probability": 0.5},
    "substitution": {"probability": 0.5, "values": BOX},
    "injection": {"count": {"poisson": 2.0}, "values": BOX},
    "sybil": {"identity": "s9", "count": {"uniform": [0, 3]}, "values": BOX},
    "babbling": {"count": {"poisson": 2.0}, "spread": 1.0},
    "byzantine": {"spread": 1.0},
}
OBSERVING = {"hold": {}, "stale": {"age": 2}, "replay": {"capture": [0, 3]}}
EVERY = {**OPEN_LOOP, **OBSERVING}
STEPS, FIRST = 30, 5
Noted = list[tuple[Any, ...]]


def kind_of(name: str) -> Kind:
    parameters = values(fill(parameters_model(find_kind("attacks", name, Path(".")), "attacks"), EVERY[name]))
    return Kind(BUILT_IN["attacks"][name], parameters)


def plan_of(attacks: Sequence[str], links: Sequence[str], method: str, first: int = FIRST) -> Plan:
    """Return a plan in which every attack stands on every link; all nodes run one method."""
    stages = tuple(
        StagePlan(name, kind_of(name), {link: link for link in links}, name, TimingPlan(first, STEPS - 1))
        for name in attacks
    )
    ends = [link.split("->") for link in links]
    return Plan(
        *("draws", 3, 0, STEPS, 0.1, PlantPlan("plant", NOWHERE)),
        tuple(SensorPlan(name, NOWHERE) for name in sorted({source for source, _ in ends})),
        tuple(EstimatorPlan(name, Kind(method), (), {}, 0) for name in sorted({end for _, end in ends})),
        stages,
        tuple(LinkPlan(source, end, keys.MEASUREMENT, tuple(attacks)) for source, end in ends),
    )


def played(plan: Plan, quiet: Sequence[int] = ()) -> tuple[dict[str, Noted], dict[str, Noted]]:
    """Return the events of each stage on s1->e1, and what arrived at each receiver."""
    network = build_network(plan, keys.MEASUREMENT)
    events: dict[str, Noted] = {stage.label: [] for stage in plan.stages}
    arrived: dict[str, Noted] = {}
    for step in range(STEPS):
        for source in network.sources:
            genuine = Packet(source, step, step, keys.MEASUREMENT, np.array([1.0 + step, 2.0]))
            sent = [] if step in quiet else [genuine]
            for receiver, packets, _ in network.transmit(source, step, 0, sent):
                rows = arrived.setdefault(receiver, [])
                rows += [(p.source, p.sent_step, p.sequence, p.values.tolist()) for p in packets]
        happened = network.take_events(step, 0)
        account = happened and happened.message()
        assert account is not None
        columns = (account.event_link, account.event_stage, account.event_action, account.event_magnitude)
        for link, stage, action, magnitude in zip(*columns, strict=True):
            if link == "s1->e1":
                events[stage].append((step, action, magnitude))
    return events, arrived


def test_the_kinds_say_whether_they_are_open_loop():
    for name in EVERY:
        assert find_kind("attacks", name, Path(".")).type.open_loop is (name in OPEN_LOOP)


@pytest.mark.parametrize("name", EVERY)
def test_two_methods_under_one_topology_and_seed_meet_the_same_fates_and_values(name):
    one, other = (played(plan_of([name], ["s1->e1"], method)) for method in ("a:Kalman", "b:Particle"))
    assert one == other
    assert one[0][name]


@pytest.mark.parametrize("name", EVERY)
def test_the_presence_of_other_links_changes_no_draw(name):
    alone, _ = played(plan_of([name], ["s1->e1"], "a:A"))
    among, _ = played(plan_of([name], ["s0->e1", "s1->e0", "s1->e1", "s2->e1"], "a:A"))
    assert alone == among


@pytest.mark.parametrize("name", OPEN_LOOP)
def test_a_later_window_or_a_quiet_slot_changes_no_draw_of_the_other_slots(name):
    late = 12
    whole, _ = played(plan_of([name], ["s1->e1"], "a:A"))
    quiet, _ = played(plan_of([name], ["s1->e1"], "a:A"), quiet=[8, 9])
    assert [row for row in quiet[name] if row[0] not in (8, 9)] == [
        row for row in whole[name] if row[0] not in (8, 9)
    ]
    if name not in ("drift", "converging_bias"):  # these count from their window's first step
        shorter, _ = played(plan_of([name], ["s1->e1"], "a:A", first=late))
        assert shorter[name] == [row for row in whole[name] if row[0] >= late]


@pytest.mark.parametrize("removed", EVERY)
def test_removing_an_attack_leaves_the_occurrence_of_all_others_as_it_was(removed):
    """Attacks in a row see what those before them made, so each has a link of its own here."""
    links = {name: f"s{number}->e1" for number, name in enumerate(EVERY)}

    def fates(names: Sequence[str]) -> dict[str, Noted]:
        plan = plan_of([], list(links.values()), "a:A")
        stages = [
            StagePlan(name, kind_of(name), {links[name]: links[name]}, "attack", TimingPlan(FIRST, STEPS - 1))
            for name in names
        ]
        on = {links[name]: (name,) for name in names}
        placed = [LinkPlan(*link.split("->"), keys.MEASUREMENT, on.get(link, ())) for link in links.values()]
        fields = {name: getattr(plan, name) for name in plan.__dataclass_fields__}
        network = build_network(
            Plan(**fields | {"stages": tuple(stages), "links": tuple(placed)}), "measurement"
        )
        noted: dict[str, Noted] = {name: [] for name in names}
        for step in range(STEPS):
            for source in network.sources:
                genuine = Packet(source, step, step, keys.MEASUREMENT, np.array([1.0 + step, 2.0]))
                network.transmit(source, step, 0, [genuine])
            happened = network.take_events(step, 0)
            account = happened and happened.message()
            assert account is not None
            for stage, action, size in zip(
                account.event_stage, account.event_action, account.event_magnitude, strict=True
            ):
                noted[stage].append((step, action, size))
        return noted

    every, fewer = fates(list(EVERY)), fates([name for name in EVERY if name != removed])
    assert fewer == {name: rows for name, rows in every.items() if name != removed}
    assert all(every.values())
