"""The oracle on the bus: the channel speaks it to those who were granted it, with the same bytes anywhere."""

from __future__ import annotations

from pathlib import Path

import pytest

from bus.messages import Inbox
from bus.packets import ORACLE
from orchestrator.log.reader import read_log
from tests.system.conftest import Gauntlet

TOLD = """
name: told
seed: 3
period_s: 1.0
steps: 30
plant: {model: quadruple_tank}
sensors:
  s1: {model: linear, C: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], noise: {std: 0.03}}
estimators:
  told: {method: particle_fdi, sensors: [s1], particles: 50, minimum_attack: 0.28, attack_estimate: oracle}
  honest: {method: particle_fdi, sensors: [s1], particles: 50, minimum_attack: 0.28}
attacks:
  - {converging_bias: {target: 0.5}, on: "s1->*", stream: s1, name: bias}
oracles: {told: [bias]}
integrity: {s1: mac}
adversary: {knows: [keys]}
"""


def inboxes(log: Path) -> dict[str, list[Inbox]]:
    found: dict[str, list[Inbox]] = {}
    for topic, message in read_log(log).records():
        if isinstance(message, Inbox):
            found.setdefault(topic.split("/")[1], []).append(message)
    return found


def test_only_who_was_granted_the_oracle_hears_it_with_the_same_bytes_in_any_backend(
    gauntlet: Gauntlet,
) -> None:
    """The sensor seals its packets; the oracle's word needs no seal, for only the channel can write it."""
    topology = gauntlet.write(TOLD)
    many = gauntlet.log(topology, out="many")
    assert many == gauntlet.log(topology, "--backend", "inprocess", out="one")
    received = inboxes(gauntlet.home / "many" / "run.mcap")
    assert [inbox.kind.count(ORACLE) for inbox in received["told"]] == [1] * 30
    assert all(ORACLE not in inbox.kind for inbox in received["honest"])
    for step, inbox in enumerate(received["told"]):
        gamma = 0.5 * (1.0 - 0.9**step)
        assert inbox.values[-4:] == pytest.approx([gamma] * 4, abs=1e-12)


def test_the_score_names_the_privilege_and_counts_no_oracle_as_a_packet(
    gauntlet: Gauntlet,
) -> None:
    run = gauntlet.run(gauntlet.write(TOLD), "--backend", "inprocess")
    score = run.score()
    assert {node["name"]: node["privileged"] for node in score["nodes"]} == {"told": ["bias"], "honest": []}
    links = {link["name"]: link for link in score["links"]}
    told, honest = (links[f"s1->{name}"] for name in ("told", "honest"))
    assert told["traffic"] == honest["traffic"]
    verdicts = ("true_positive", "false_positive", "false_negative", "true_negative")
    assert sum(told["detector"][name] for name in verdicts) == 30
    assert score["unmatched_verdicts"] == 0
    assert "PRIVILEGED: told of bias" in run.output[0]


def test_without_the_grant_no_process_is_started(gauntlet: Gauntlet) -> None:
    run = gauntlet.run(gauntlet.write(TOLD.replace("oracles: {told: [bias]}\n", "")))
    assert run.process.returncode == 2
    assert "is a privilege that the topology does not grant" in run.errors
