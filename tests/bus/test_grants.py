"""The rules of a run: who may say and hear what. That the router enforces them is tested with the bus."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import pytest
from zenoh import KeyExpr

from bus import keys
from bus.access import Grant
from bus.grants import CHANNEL, grant, inputs, outputs, paced, process_names, subscriptions
from bus.plan import Plan
from orchestrator.log.order import canonical_topics, owner
from orchestrator.topology.load import load_topology

ROOT = Path(__file__).parents[2]
RUN = "r1"
MIXED = """
period_s: 0.1
steps: 5
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
sensors:
  s1..s3: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}
estimators:
  e1..e2: {method: secure_distributed, coupling: 0.01}
  e3: {method: secure_distributed, coupling: 0.01, sensors: []}
  f1: {method: kalman_centralized}
  f2: {method: kalman, sensors: [s1, s2]}
graph: {edges: [[e1, e2], [e2, e3]]}
"""


@pytest.fixture(scope="module", params=["mixed", "case_b"])
def plan(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Plan:
    if request.param == "case_b":
        return load_topology(ROOT / "topologies" / "ding2021" / "case_b.yaml").plan
    path = tmp_path_factory.mktemp("topology") / "mixed.yaml"
    path.write_text(MIXED)
    return load_topology(path).plan


@pytest.fixture(scope="module")
def grants(plan: Plan) -> dict[str, Grant]:
    return {name: grant(plan, RUN, name) for name in process_names(plan)}


def key(topic: str, run: str = RUN) -> str:
    return keys.prefix(run) + topic


def meets(expressions: tuple[str, ...], other: str) -> bool:
    """Whether something may pass on a key that both allow: the bus library's own judgement."""
    return any(KeyExpr(expression).intersects(KeyExpr(other)) for expression in expressions)


def may_put(grants: dict[str, Grant], expression: str) -> set[str]:
    return {name for name, own in grants.items() if meets(own.may_put, expression)}


def may_hear(grants: dict[str, Grant], expression: str) -> set[str]:
    return {name for name, own in grants.items() if meets(own.may_subscribe, expression)}


def test_of_all_processes_only_sensors_hear_the_truth(plan: Plan, grants: dict[str, Grant]) -> None:
    assert may_hear(grants, key("truth/**")) == {sensor.name for sensor in plan.sensors}


def test_every_topic_of_the_log_has_exactly_one_process_that_may_send_on_it(
    plan: Plan, grants: dict[str, Grant]
) -> None:
    for topic in canonical_topics(plan):
        assert may_put(grants, key(topic)) == {owner(topic)}


def test_nobody_may_send_on_a_key_of_another(grants: dict[str, Grant]) -> None:
    for one, another in combinations(grants.values(), 2):
        assert not any(meets(one.may_put, expression) for expression in another.may_put)
        assert one.alive != another.alive
        assert one.user != another.user


def test_what_may_be_sent_is_named_without_wildcards(grants: dict[str, Grant]) -> None:
    assert not [own for own in grants.values() if any("*" in expression for expression in own.may_put)]


def test_what_may_be_sent_is_what_the_log_holds_and_the_last_words(
    plan: Plan, grants: dict[str, Grant]
) -> None:
    recorded = {key(topic) for topic in canonical_topics(plan)}
    last_words = {key(keys.finished(name)) for name in grants}
    assert {expression for own in grants.values() for expression in own.may_put} == recorded | last_words


def test_nobody_hears_anothers_inbox_estimates_or_the_channels_account(
    plan: Plan, grants: dict[str, Grant]
) -> None:
    for own in plan.estimators:
        assert may_hear(grants, key(keys.rx(own.name, "*"))) <= {own.name}
    assert not may_hear(grants, key("estimate/**"))
    assert not may_hear(grants, key("channel/**"))
    assert not may_hear(grants, key("control/finished/**"))


def test_what_is_sent_reaches_nobody_but_the_channel(grants: dict[str, Grant]) -> None:
    assert may_hear(grants, key("tx/**")) == {CHANNEL}


def test_only_the_orchestrator_starts_stops_and_gives_credit(plan: Plan, grants: dict[str, Grant]) -> None:
    for topic in (keys.START, keys.STOP, *(keys.credit(name) for name in grants)):
        assert not may_put(grants, key(topic))
    assert {name for name in grants if may_hear(grants, key(keys.credit(name)))} == set(paced(plan))


def test_everybody_hears_what_it_waits_for_and_may_send_what_it_sends(
    plan: Plan, grants: dict[str, Grant]
) -> None:
    for name, own in grants.items():
        for topic in (*inputs(plan, name), *subscriptions(plan, name), keys.START, keys.STOP):
            assert meets(own.may_subscribe, key(topic))
        for topic in outputs(plan, name):
            assert meets(own.may_put, key(topic))


def test_runs_side_by_side_share_no_key(plan: Plan, grants: dict[str, Grant]) -> None:
    for name, own in grants.items():
        other = grant(plan, "r2", name)
        for mine in (*own.may_put, *own.may_subscribe, own.alive):
            assert not meets((*other.may_put, *other.may_subscribe, other.alive), mine)
