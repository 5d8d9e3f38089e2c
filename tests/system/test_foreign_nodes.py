"""Nodes that are not ours: one that keeps to the wire protocol, and one that peeks, forges and floods."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from orchestrator.log.reader import read_log
from tests.system.conftest import PLUGIN, SMALL, Gauntlet

FOREIGN = Path(__file__).parent / "plugins" / "foreign_node.py"


def topology(gauntlet: Gauntlet, fourth: str, name: str) -> Path:
    lines = f"  e1..e3: {{method: kalman}}\n  e4: {fourth}\n"
    text = SMALL.replace("  e1..e4: {method: secure_distributed, coupling: 0.01}\n", lines)
    return gauntlet.write(
        text.replace("  e*->e*: [{gilbert_elliott: {failure: 0.2, recovery: 0.5}}]\n", ""), name
    )


def external(*arguments: str | Path) -> str:
    return (
        "{method: external, command: "
        + json.dumps([sys.executable, str(FOREIGN), *map(str, arguments)])
        + "}"
    )


@pytest.fixture
def reference(gauntlet: Gauntlet) -> list[object]:
    """The messages of the same network with a node of ours that says the same as the foreign one."""
    ours = topology(gauntlet, f"{{method: '{PLUGIN}:Misbehaving'}}", "ours.yaml")
    gauntlet.log(ours, "--backend", "inprocess", out="reference")
    return list(read_log(gauntlet.home / "reference" / "run.mcap").records())


def test_a_foreign_node_takes_part_by_the_wire_protocol_alone(
    gauntlet: Gauntlet, reference: list[object]
) -> None:
    run = gauntlet.run(topology(gauntlet, external(), "foreign.yaml"))
    assert run.process.returncode == 0, run.errors
    assert list(read_log(run.out / "run.mcap").records()) == reference


def test_a_node_that_peeks_forges_and_floods_hears_nothing_and_disturbs_nothing(
    gauntlet: Gauntlet, reference: list[object]
) -> None:
    heard = gauntlet.home / "heard.json"
    run = gauntlet.run(topology(gauntlet, external("rude", heard), "rude.yaml"))
    assert run.process.returncode == 0, run.errors
    assert json.loads(heard.read_text()) == [], "the truth and others' inboxes are not for an estimator"
    assert list(read_log(run.out / "run.mcap").records()) == reference
    rejected = json.loads((run.out / "timing.json").read_text())["rejected_messages"]
    assert rejected == {"recorder": {"estimate/e4": 4 * 40}}, "counted by topic; the forged keys never arrive"


def test_a_foreign_node_cannot_run_inside_another_process(gauntlet: Gauntlet) -> None:
    run = gauntlet.run(topology(gauntlet, external(), "foreign.yaml"), "--backend", "inprocess")
    assert run.process.returncode == 3
    assert "e4 is an external node: run it with the backend 'processes'" in run.errors


def test_a_foreign_program_that_does_not_exist_is_named(gauntlet: Gauntlet) -> None:
    run = gauntlet.run(topology(gauntlet, "{method: external, command: [no-such-program]}", "none.yaml"))
    assert run.process.returncode == 3
    assert "no-such-program" in run.errors


def test_a_foreign_program_that_never_joins_is_named(gauntlet: Gauntlet) -> None:
    sleeper = json.dumps([sys.executable, "-c", "import time; time.sleep(60)"])
    absent = topology(gauntlet, f"{{method: external, command: {sleeper}}}", "absent.yaml")
    run = gauntlet.run(absent, "--set", "process.stall_s=3")
    assert run.process.returncode == 3
    assert "not on the bus after 3 s: e4" in run.errors


def test_a_guessed_password_is_not_admitted(gauntlet: Gauntlet) -> None:
    liar = json.dumps(["env", "GAUNTLET_PASSWORD=guessed", sys.executable, str(FOREIGN)])
    run = gauntlet.run(topology(gauntlet, f"{{method: external, command: {liar}}}", "liar.yaml"))
    assert run.process.returncode == 3
    assert "e4 failed" in run.errors
