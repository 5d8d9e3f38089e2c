"""The topologies of this repository, their JSON Schema, and their pictures."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from ruamel.yaml import YAML

from orchestrator.graph_drawing import DrawingError, draw, drawn_links, layout
from orchestrator.topology.json_schema import schema, schema_text
from orchestrator.topology.load import find_problems, load_topology

ROOT = Path(__file__).parents[3]
SCHEMA = ROOT / "docs" / "topology.schema.json"
EXAMPLES = sorted((ROOT / "topologies").glob("*/*.yaml"))
CASE_B = ROOT / "topologies" / "ding2021" / "case_b.yaml"


def read(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_example_is_in_order(path: Path) -> None:
    assert find_problems(path) == ((), ())


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_example_leads_editors_to_the_schema_and_fits_it(path: Path) -> None:
    text = path.read_text()
    modeline = re.match(r"# yaml-language-server: \$schema=(\S+)\n", text)
    assert modeline is not None
    assert (path.parent / modeline[1]).resolve() == SCHEMA
    jsonschema.validate(read(text), schema())


def test_the_schema_in_the_docs_is_up_to_date() -> None:
    """Otherwise: python -m orchestrator.topology.json_schema > docs/topology.schema.json."""
    assert SCHEMA.read_text() == schema_text()


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        ("steps: 3", True),
        ("steps: -3", False),
        ("stepz: 3", False),
        ("sensors: {s1: {model: linear, D: 3}}", False),
        ("sensors: {s1: {model: './x.py:A', D: 3}}", True),
        ("sensors: {s1: null}", True),
        ("estimators: {e1: {method: kalman, sensors: [s1]}}", True),
        ("estimators: {e1: {method: kalmann}}", False),
        ("sensors: {s1: {model: linear, send: {send_on_delta: {threshold: 0.1}}}}", True),
        ("sensors: {s1: {model: linear, send: {send_on_delta: {treshold: 0.1}}}}", False),
        ("estimators: {e1: {method: kalman, send: {periodic: {every: 2}}}}", True),
        ("estimators: {e1: {method: kalman, send: null}}", True),
        ("channel: {a: [perfect, {bernoulli: {loss: 0.3, scope: shared}}]}", True),
        ("channel: {a: {bernoulli: {loss: 3}}}", False),
        ("graph: {ring: {nodes: 3}, weights: metropolis}", True),
        ("graph: {rign: {nodes: 3}}", False),
        ("attacks: [{bias: {value: 3}, on: a->b, steps: [3, 4]}]", True),
        ("attacks: [{bias: {valu: 3}, on: a->b}]", False),
        ("attacks: [{signal: {value: [3]}, on: plant}, {crash: {}, on: e3}]", True),
        ("controllers: {c1: {law: lqr, estimator: e1, input_weight: [1]}}", True),
        ("controllers: {c1: {law: lqr, estimator: e1, gain: [[1]]}}", False),
        ("expect: {divergences: 0, rmse.position: {node: e1, at_most: 3}, peak.state: null}", True),
        ("expect: {packets.lost: [{link: a->b, equals: 20}, {at_least: 3}]}", True),
        ("expect: {rmze.position: 3}", False),
        ("expect: {rmse: 3}", False),
        ("expect: {rmse.*: 3}", False),
        ("expect: {packets.lots: 3}", False),
        ("expect: {rmse.position: {node: e1}}", False),
        ("{extends: a.yaml, expect: {rmse.position: {node: e1}}}", True),
        ("{extends: a.yaml, expect: {rmse.position: [{node: e1}]}}", False),
        ("expect: {rmse.position: {}}", False),
        ("attacks: [{bias: {value: 3}}]", False),
        ("attacks: [{on: a->b, steps: [3, 4]}]", False),
        ("attacks: [{bias: {value: 3}, drift: {rate: 3}, on: a->b}]", False),
        ("attacks: [{'./x.py:A': {value: 3}, on: a->b}, {'x:B': null, on: a->b}]", True),
        ("attacks: [{'./x.py:A': {value: 3}, bias: {value: 3}, on: a->b}]", False),
        ("channel: {a: {scope: shared}}", False),
        ("channel: {a: [{'./x.py:A': {p: 3}}]}", True),
        ("sensors: {s1: {model: linear, noise: {std: -1}}}", False),
        ("sensors: {s1: {model: linear, noise: {std: [0.1, -1]}}}", False),
        ("sensors: {s1: {model: linear, noise: {std: [0.1, 0]}}}", True),
        ("attacks: [{noise: {std: -1}, on: a->b}]", False),
    ],
)
def test_the_schema_tells_editors_what_fits(text: str, fits: bool) -> None:
    validator = jsonschema.Draft202012Validator(schema())
    assert validator.is_valid(read(text)) is fits


def _documented() -> tuple[str, list[str], list[str]]:
    """Return the reference's whole example, its sections, and its overrides."""
    text = (ROOT / "docs" / "topology.md").read_text()
    whole, *sections = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    return whole, sections, re.findall(r"^\| .*?`--set (\S+=\S+?)`", text, re.MULTILINE)


def test_the_examples_of_the_reference_are_in_order(tmp_path: Path) -> None:
    whole, sections, overrides = _documented()
    path = tmp_path / "example.yaml"
    path.write_text(whole)
    assert find_problems(path) == ((), ())
    for override in overrides:
        assert find_problems(path, [override])[0] == ()
    for section in sections:
        path.write_text(json.dumps({**read(whole), **read(section)}))
        assert find_problems(path)[0] == ()


def test_a_resolved_topology_fits_the_schema() -> None:
    jsonschema.validate(read(load_topology(CASE_B).resolved_yaml()), schema())


def test_the_drawing_marks_attacked_and_lossy_links() -> None:
    lines = {(line.source, line.destination): line for line in drawn_links(load_topology(CASE_B).plan)}
    assert lines["s4", "e4"].attacked
    assert not lines["s5", "e5"].attacked
    assert not lines["s4", "e4"].lossy
    between = [line for line in lines.values() if line.source.startswith("e")]
    assert all(line.lossy and line.both_ways and not line.attacked for line in between)
    assert 2 * len(between) + 20 == len(load_topology(CASE_B).plan.links)


def test_no_two_nodes_stand_on_one_another() -> None:
    overrides = ["estimators.centre={method: kalman_centralized}", "estimators.e7.method=kalman"]
    places = list(layout(load_topology(CASE_B, overrides).plan).values())
    assert min(abs(complex(*a) - complex(*b)) for i, a in enumerate(places) for b in places[:i]) > 0.1


@pytest.mark.parametrize(("ending", "magic"), [("svg", b"<?xml"), ("png", b"\x89PNG")])
def test_a_picture_is_written_the_same_every_time(ending: str, magic: bytes, tmp_path: Path) -> None:
    plan = load_topology(CASE_B).plan
    first, second = tmp_path / f"first.{ending}", tmp_path / f"second.{ending}"
    draw(plan, first)
    draw(plan, second)
    assert first.read_bytes().startswith(magic)
    assert first.read_bytes() == second.read_bytes()


def test_a_picture_of_an_unknown_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DrawingError, match=r"ending '\.bmp'"):
        draw(load_topology(CASE_B).plan, tmp_path / "network.bmp")
