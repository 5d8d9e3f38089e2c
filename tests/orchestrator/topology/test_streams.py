"""Where stages stand, in which order they act, and which random streams they draw from."""

from __future__ import annotations

from pathlib import Path

from bus.plan import Plan, StagePlan
from orchestrator.topology.load import load_topology

TEXT = """\
period_s: 0.1
steps: 20
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
sensors: {s1..s3: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}}
estimators: {e1..e3: {method: secure_distributed, coupling: 0.01}, k1..k3: {method: kalman}}
graph: {ring: {nodes: 3}}
"""


def plan_of(folder: Path, text: str) -> Plan:
    path = folder / "topology.yaml"
    path.write_text(TEXT + text)
    return load_topology(path).plan


def stages_on(plan: Plan, name: str) -> list[StagePlan]:
    (link,) = (link for link in plan.links if link.name == name)
    by_label = {stage.label: stage for stage in plan.stages}
    return [by_label[label] for label in link.stages]


def addresses(plan: Plan, name: str) -> list[tuple[str, str]]:
    return [(stage.streams[name], stage.purpose) for stage in stages_on(plan, name)]


def test_each_link_draws_from_its_own_stream(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, "channel: {e*->e*: {bernoulli: {loss: 0.1}}}\n")
    assert addresses(plan, "e1->e2") == [("e1->e2", "channel/bernoulli")]
    assert addresses(plan, "e2->e1") == [("e2->e1", "channel/bernoulli")]


def test_a_shared_stage_has_one_stream(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, "channel: {e*->e*: {bernoulli: {loss: 0.1, scope: shared}}}\n")
    (stage,) = plan.stages
    assert set(stage.streams.values()) == {"e*->e*"}
    assert len(stage.streams) == 6


def test_estimators_side_by_side_can_be_given_the_same_losses(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, 'channel: {s*->*: {bernoulli: {loss: 0.1, stream: "{source}"}}}\n')
    assert addresses(plan, "s1->e1") == addresses(plan, "s1->k1") == [("s1", "channel/bernoulli")]
    assert addresses(plan, "s2->e2") != addresses(plan, "s1->e1")


def test_families_side_by_side_can_be_given_the_same_losses_between_neighbours(tmp_path: Path) -> None:
    text = TEXT.replace("k1..k3: {method: kalman}", "f1..f3: {method: secure_distributed, coupling: 0.1}")
    text += 'channel: {"*->*": {bernoulli: {loss: 0.1, stream: "{source_number} to {destination_number}"}}}\n'
    path = tmp_path / "topology.yaml"
    path.write_text(text)
    plan = load_topology(path).plan
    assert addresses(plan, "e1->e2") == addresses(plan, "f1->f2") == [("1 to 2", "channel/bernoulli")]


def test_attacks_act_before_the_channel_in_the_order_of_the_file(tmp_path: Path) -> None:
    text = (
        "channel: {s1->e1: [{bernoulli: {loss: 0.1}}, perfect]}\n"
        "attacks: [{bias: {value: 1}, on: s*->e*, name: wide}, {bias: {value: 2}, on: s1->e1}]\n"
    )
    labels = [stage.label for stage in stages_on(plan_of(tmp_path, text), "s1->e1")]
    assert labels == ["wide", "bias@s1->e1", "bernoulli@s1->e1", "perfect@s1->e1"]


def test_the_last_pattern_that_fits_a_link_is_its_channel(tmp_path: Path) -> None:
    text = 'channel: {"*->*": {bernoulli: {loss: 0.1}}, s1->*: perfect, s1->k1: []}\n'
    plan = plan_of(tmp_path, text)
    assert [stage.label for stage in stages_on(plan, "s2->e2")] == ["bernoulli@*->*"]
    assert [stage.label for stage in stages_on(plan, "s1->e1")] == ["perfect@s1->*"]
    assert stages_on(plan, "s1->k1") == []


def test_the_same_kind_twice_on_a_link_draws_twice(tmp_path: Path) -> None:
    text = "channel: {e*->e*: [{bernoulli: {loss: 0.1}}, {bernoulli: {loss: 0.2}}]}\n"
    found = addresses(plan_of(tmp_path, text), "e1->e2")
    assert found == [("e1->e2", "channel/bernoulli"), ("e1->e2#2", "channel/bernoulli")]


def test_each_window_of_an_attack_is_a_stage_with_its_own_draws(tmp_path: Path) -> None:
    text = "attacks: [{bias: {value: 1}, on: s1->e1, steps: [[3, 5], [7, 9]]}]\n"
    stages = stages_on(plan_of(tmp_path, text), "s1->e1")
    assert [(stage.label, stage.timing.first, stage.timing.last) for stage in stages] == [
        ("bias@s1->e1", 3, 5),
        ("bias@s1->e1/2", 7, 9),
    ]
    assert len({stage.purpose for stage in stages}) == 2


def test_taking_a_stage_away_moves_no_other_draw(tmp_path: Path) -> None:
    channel = (
        "channel: {e*->e*: [{gilbert_elliott: {failure: 0.1, recovery: 0.9}}, {bernoulli: {loss: 0.1}}]}\n"
    )
    attacks = "attacks: [{bias: {value: 1}, on: s1->e1}, {bias: {value: 1}, on: s2->e2}]\n"
    whole = plan_of(tmp_path, channel + attacks)
    without_attack = plan_of(tmp_path, channel + "attacks: [{bias: {value: 9}, on: s2->e2}]\n")
    without_stage = plan_of(tmp_path, "channel: {e1->e*: {bernoulli: {loss: 0.7}}}\n" + attacks)
    assert (
        addresses(whole, "s2->e2")
        == addresses(without_attack, "s2->e2")
        == addresses(without_stage, "s2->e2")
    )
    assert addresses(whole, "e1->e2") == addresses(without_attack, "e1->e2")
    assert addresses(whole, "e1->e2")[1:] == addresses(without_stage, "e1->e2")


def test_a_name_keeps_the_draws_of_the_second_of_two_alike(tmp_path: Path) -> None:
    both = "attacks: [{bias: {value: 1}, on: s1->e1}, {bias: {value: 2}, on: s1->e1, name: late}]\n"
    one = "attacks: [{bias: {value: 2}, on: s1->e1, name: late}]\n"
    assert addresses(plan_of(tmp_path, both), "s1->e1")[1:] == addresses(plan_of(tmp_path, one), "s1->e1")


def test_a_channel_may_reach_measurements_and_exchange(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, 'channel: {"*->*": {bernoulli: {loss: 0.1}}}\n')
    assert {link.stream for link in plan.links} == {"measurement", "exchange"}
    assert all(link.stages for link in plan.links)
