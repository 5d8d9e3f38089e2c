"""The layout for Foxglove and Lichtblick shows what a log really holds."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from orchestrator.run import run_topology
from orchestrator.topology.load import load_topology

ROOT = Path(__file__).parents[2]
LAYOUT = json.loads((ROOT / "docs" / "foxglove" / "gauntlet.json").read_text())
PATH = re.compile(r"(?P<topic>\w+(?:/\w+)*)(?:\.(?P<field>\w+)(?:\[(?P<index>\d*:?\d*)\])?)?")
"""What the viewers' message paths have in common, as far as it is used here."""


def _panels(tree: Any) -> list[str]:
    if isinstance(tree, str):
        return [tree]
    assert set(tree) == {"direction", "first", "second", "splitPercentage"}
    assert tree["direction"] in {"row", "column"}
    assert 0 < tree["splitPercentage"] < 100
    return _panels(tree["first"]) + _panels(tree["second"])


def _paths(panel: str) -> list[str]:
    settings = LAYOUT["configById"][panel]
    if panel.startswith("RawMessages!"):
        return [settings["topicPath"]]
    return [path["value"] for path in settings["paths"]]


PATHS = [(panel, path) for panel in LAYOUT["configById"] for path in _paths(panel)]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Any, list[Any]]]:
    """The schema and the messages of each topic of a log, as any reader of MCAP finds them."""
    folder = tmp_path_factory.mktemp("foxglove")
    topology = load_topology(ROOT / "topologies" / "ding2021" / "case_b.yaml")
    run_topology(topology, folder, "inprocess", lambda recorded: None)
    found: dict[str, tuple[Any, list[Any]]] = {}
    with (folder / "run.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            found.setdefault(channel.topic, (json.loads(schema.data), []))[1].append(json.loads(message.data))
    return found


def test_the_layout_places_every_panel_once() -> None:
    assert set(LAYOUT) == {"configById", "globalVariables", "layout", "playbackConfig", "userNodes"}
    assert sorted(_panels(LAYOUT["layout"])) == sorted(LAYOUT["configById"])
    kinds = {panel.partition("!")[0] for panel in LAYOUT["configById"]}
    assert kinds == {"Plot", "RawMessages", "StateTransitions"}


@pytest.mark.parametrize(("panel", "path"), PATHS, ids=lambda part: str(part))
def test_every_path_leads_to_data_of_the_kind_that_its_panel_shows(
    panel: str, path: str, log: dict[str, tuple[Any, list[Any]]]
) -> None:
    parsed = PATH.fullmatch(path)
    assert parsed is not None
    schema, messages = log[parsed["topic"]]
    if parsed["field"] is None:
        assert panel.startswith("RawMessages!")
        return
    declared = schema["properties"][parsed["field"]]
    assert (parsed["index"] is not None) == (declared["type"] == "array")
    values = [message[parsed["field"]] for message in messages]
    if parsed["index"] is not None:
        declared = declared["items"]
        values = (
            [value for own in values for value in own]
            if ":" in parsed["index"]
            else [own[int(parsed["index"])] for own in values if len(own) > int(parsed["index"])]
        )
    assert values, "some message has it"
    wanted = {"integer", "number"} if panel.startswith("Plot!") else {"boolean", "string"}
    assert declared["type"] in wanted


def test_what_happens_in_the_run_is_to_be_seen(log: dict[str, tuple[Any, list[Any]]]) -> None:
    shown = {path for _, path in PATHS}
    assert {"channel/correct.attacked[:]", "channel/correct", "estimate/e4.detector_alarm[0]"} <= shown
    alarms = [message["step"] for message in log["estimate/e4"][1] if any(message["detector_alarm"])]
    assert alarms == list(range(90, 96))
