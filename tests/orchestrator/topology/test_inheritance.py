"""``extends``: mappings merge deeply, lists replace, null removes, groups split, a new kind begins anew."""

from __future__ import annotations

from pathlib import Path

import pytest

from orchestrator.topology.load import Topology, load_topology
from tests.orchestrator.topology.small import GOOD

BASE = (
    "name: base\ndescription: prose\n"
    + GOOD
    + """\
  s*->e*: {bernoulli: {loss: 0.2}}
attacks:
  - {bias: {value: 1}, on: s1->e1, steps: [3, 5]}
expect: {divergences: 0}
"""
)


@pytest.fixture
def base(tmp_path: Path) -> Path:
    path = tmp_path / "base.yaml"
    path.write_text(BASE)
    return path


def heir(base: Path, text: str) -> Topology:
    path = base.with_name("heir.yaml")
    path.write_text(f"extends: base.yaml\n{text}")
    return load_topology(path)


def test_an_heir_that_says_nothing_differs_in_name_and_prose_only(base: Path) -> None:
    same = heir(base, "")
    assert (same.name, same.document["description"]) == ("heir", "")
    changed = {**load_topology(base).document, "name": "heir", "description": ""}
    assert same.document == changed


def test_mappings_merge_deeply(base: Path) -> None:
    plan = heir(base, "plant: {initial: {std: 5}}\n").plan
    assert plan.plant.kind.parameters["initial"].std == 5.0
    assert plan.plant.kind.parameters["process_noise"].std == 0.2


def test_one_node_splits_its_group(base: Path) -> None:
    plan = heir(base, "sensors: {s2: {noise: {std: 7}}}\n").plan
    assert [sensor.kind.parameters["noise"].std for sensor in plan.sensors] == [0.1, 7.0, 0.1, 0.1]


def test_a_range_may_cut_across_groups_and_add_nodes(base: Path) -> None:
    group = "{model: linear, C: [[1, 0, 0]], noise: {std: 7}}"
    text = f"sensors: {{s3..s5: {group}}}\nestimators: {{k5: {{method: kalman}}}}\n"
    plan = heir(base, text).plan
    assert [sensor.kind.parameters["noise"].std for sensor in plan.sensors] == [0.1, 0.1, 7.0, 7.0, 7.0]


def test_lists_and_stages_replace(base: Path) -> None:
    text = "attacks: [{bias: {value: 2}, on: s2->e2}]\n"
    text += "channel: {e*->e*: {gilbert_elliott: {failure: 0.1, recovery: 0.9}}}\n"
    labels = [stage.label for stage in heir(base, text).plan.stages]
    assert labels == ["bias@s2->e2", "gilbert_elliott@e*->e*", "bernoulli@s*->e*"]


def test_null_removes(base: Path) -> None:
    text = "attacks: null\nchannel: {s*->e*: null}\nexpect: {divergences: null}\n"
    topology = heir(base, text)
    assert [stage.label for stage in topology.plan.stages] == ["bernoulli@e*->e*"]
    assert topology.expectations == ()


def test_another_method_begins_with_no_parameters(base: Path) -> None:
    text = "estimators: {e1..e4: {method: fixed_gain_consensus, gain: [0.4, 0.5, 0.4], coupling: 0.02}}\n"
    kind = heir(base, text).plan.estimators[0].kind
    assert kind.parameters == {"gain": [0.4, 0.5, 0.4], "coupling": 0.02}


def test_another_graph_replaces_the_graph(base: Path) -> None:
    plan = heir(base, "graph: {complete: {nodes: 4}}\n").plan
    assert dict(plan.estimators[0].neighbours) == {"e2": 1 / 3, "e3": 1 / 3, "e4": 1 / 3}


def test_the_same_graph_keeps_its_parameters(base: Path) -> None:
    base.write_text(BASE.replace("nodes: 4", "nodes: 4, neighbours: 2"))
    assert len(heir(base, "graph: {ring: {nodes: 4}}\n").plan.links) == 12


def test_files_are_found_from_the_file_that_names_them(base: Path, tmp_path: Path) -> None:
    folder = tmp_path / "below"
    folder.mkdir()
    (tmp_path / "mine.py").write_text(
        "from nodes.estimators.kalman import Kalman\n\n\nclass Mine(Kalman):\n    pass\n"
    )
    base.write_text(
        BASE.replace(
            "{method: secure_distributed, coupling: 0.01, threshold: 9}", "{method: ./mine.py:Mine}"
        ).replace("  e*->e*: {bernoulli: {loss: 0.1}}\n", "")
    )
    (folder / "case.yaml").write_text("extends: ../base.yaml\n")
    plan = load_topology(folder / "case.yaml").plan
    assert plan.estimators[0].kind.reference == f"{tmp_path / 'mine.py'}:Mine"
