from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bus import keys
from bus.plan import EstimatorPlan, LinkPlan, Plan
from orchestrator.log.order import (
    CHANNEL,
    Slot,
    canonical_order,
    canonical_topics,
    dependencies,
    owner,
    wait_chain,
)


def test_a_step_goes_from_truth_over_measurements_and_rounds_to_estimates(ring: Any) -> None:
    assert [f"{topic} {round_}" for topic, round_ in canonical_order(ring.plan(rounds=1))] == [
        "truth/plant 0",
        *(f"tx/s{i}/measurement 0" for i in (1, 2, 3)),
        "channel/correct 0",
        *(f"rx/e{i}/correct 0" for i in (1, 2, 3)),
        *(f"tx/e{i}/exchange 0" for i in (1, 2, 3)),
        "channel/exchange 0",
        *(f"rx/e{i}/exchange 0" for i in (1, 2, 3)),
        *(f"estimate/e{i} 0" for i in (1, 2, 3)),
    ]


def test_every_exchange_round_follows_the_one_before(ring: Any) -> None:
    rounds = [slot.round for slot in canonical_order(ring.plan(rounds=3)) if "/exchange" in slot.topic]
    assert rounds == sorted(rounds)
    assert set(rounds) == {0, 1, 2}


def test_estimators_without_rounds_exchange_nothing(ring: Any) -> None:
    assert not [topic for topic in canonical_topics(ring.plan(rounds=0)) if "exchange" in topic]


def test_an_estimator_that_nobody_hears_sends_nothing_and_one_that_hears_nobody_gets_nothing(
    plan: Plan,
) -> None:
    links = tuple(link for link in plan.links if (link.source, link.destination) != ("e3", "e1"))
    topics = canonical_topics(replace(plan, links=links))
    assert keys.tx("e3", keys.EXCHANGE) not in topics
    assert keys.rx("e1", keys.EXCHANGE) not in topics
    assert keys.rx("e3", keys.EXCHANGE) in topics


def test_an_estimator_without_sensors_gets_no_measurements(plan: Plan) -> None:
    deaf = tuple(replace(e, sensors=()) if e.name == "e2" else e for e in plan.estimators)
    links = tuple(link for link in plan.links if link.source != "s2")
    needs = dependencies(replace(plan, estimators=deaf, links=links))
    assert Slot("rx/e2/correct", 0) not in needs
    assert needs[Slot("tx/e2/exchange", 0)] == ()
    assert Slot("tx/s2/measurement", 0) in needs


def test_a_plan_without_any_link_still_has_its_truth_and_estimates(plan: Plan) -> None:
    alone = tuple(EstimatorPlan(e.name, e.kind, (), {}, 0) for e in plan.estimators)
    order = canonical_order(replace(plan, estimators=alone, links=(), sensors=()))
    assert [slot.topic for slot in order] == ["truth/plant", "estimate/e1", "estimate/e2", "estimate/e3"]


@pytest.mark.parametrize("rounds", [0, 1, 3])
def test_nothing_waits_for_what_stands_after_it_or_is_not_expected(ring: Any, rounds: int) -> None:
    seen: set[Slot] = set()
    for slot, inputs in dependencies(ring.plan(rounds=rounds)).items():
        assert seen.issuperset(inputs)
        seen.add(slot)


def test_an_estimator_that_hears_nobody_goes_on_from_its_own_last_round(plan: Plan) -> None:
    links = tuple(link for link in plan.links if link.destination != "e1")
    needs = dependencies(replace(plan, links=links))
    assert needs[Slot("tx/e1/exchange", 1)] == (Slot("tx/e1/exchange", 0),)
    assert needs[Slot("estimate/e1", 0)] == (Slot("tx/e1/exchange", 1),)


def test_topics_have_owners() -> None:
    topics = ["truth/plant", "tx/s7/measurement", "rx/e3/correct", "channel/exchange", "estimate/e3"]
    assert [owner(topic) for topic in topics] == ["plant", "s7", CHANNEL, CHANNEL, "e3"]


def missing_without(plan: Plan, topic: str, round_: int = 0) -> set[Slot]:
    """Return what a step lacks when one of its messages does not come."""
    lost: set[Slot] = set()
    for slot, inputs in dependencies(plan).items():
        if slot == (topic, round_) or not lost.isdisjoint(inputs):
            lost.add(slot)
    return lost


def test_a_stopped_sensor_is_found_behind_all_that_waits_for_it(ring: Any) -> None:
    plan = ring.plan(rounds=0)
    (cause,) = wait_chain(plan, 412, missing_without(plan, "tx/s3/measurement"))
    assert cause.owner == "s3"
    assert str(cause) == "e3 waits for slot 412 of s3->e3"


def test_a_stopped_channel_owes_what_it_did_not_deliver(ring: Any) -> None:
    plan = ring.plan(rounds=0)
    (cause,) = wait_chain(plan, 5, missing_without(plan, "rx/e2/correct"))
    assert (cause.owner, str(cause)) == (CHANNEL, "channel owes rx/e2/correct of step 5")


def test_an_estimator_that_stopped_in_a_round_is_told_with_the_round(plan: Plan) -> None:
    (cause,) = wait_chain(plan, 9, missing_without(plan, "tx/e1/exchange", 1))
    assert str(cause) == "e2 waits for slot 9 of e1->e2 (round 1)"


def test_a_stopped_plant_is_the_one_cause_of_a_whole_missing_step(plan: Plan) -> None:
    (cause,) = wait_chain(plan, 0, canonical_order(plan))
    assert cause.owner == "plant"
    assert str(cause).endswith("s1 waits for slot 0 of plant->s1")


def test_an_estimator_that_does_not_publish_owes_its_estimate(plan: Plan) -> None:
    (cause,) = wait_chain(plan, 3, {("estimate/e2", 0)})
    assert (cause.owner, str(cause)) == ("e2", "e2 owes estimate/e2 of step 3")


def test_what_nobody_waits_for_is_a_cause_too(plan: Plan) -> None:
    quiet = replace(plan, links=(LinkPlan("s1", "e1", keys.MEASUREMENT, ()),))
    (cause,) = wait_chain(quiet, 3, {("tx/s2/measurement", 0)})
    assert str(cause) == "s2 owes tx/s2/measurement of step 3"


def test_a_whole_step_has_no_causes(plan: Plan) -> None:
    assert wait_chain(plan, 3, ()) == ()
