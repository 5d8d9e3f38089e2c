"""Adversaries in a whole run: planned silence, triggers, seals; and the same bytes on both backends."""

from __future__ import annotations

from pathlib import Path

import pytest

from bus import keys
from bus.messages import ChannelEvents, Estimate, Transmission, Truth
from orchestrator.log.reader import read_log
from tests.system.conftest import SMALL, Gauntlet

CRASH, HANG = 21, 30
SILENT = f"""
  - {{crash: {{}}, on: e2, steps: [{CRASH}, 39]}}
  - {{hang: {{}}, on: s3, steps: [{HANG}, 39]}}
"""
TRIGGERED = """
  - {bias: {value: 4.0}, on: s1, when: {state_crosses: {component: 0, value: 0.5, hold: 3}}, name: crossing}
  - {bias: {value: 4.0}, on: s4->e4, when: {alarm: {of: e2, hold: 2}}, name: answer}
integrity: {s1: mac, s4: crc}
"""


def both(gauntlet: Gauntlet, text: str) -> Path:
    """Run in one process and in many; return the log, which is the same."""
    topology = gauntlet.write(text)
    one = gauntlet.log(topology, "--backend", "inprocess", out="one")
    assert gauntlet.log(topology, out="many") == one
    return gauntlet.home / "many" / "run.mcap"


def test_a_node_that_crashes_or_hangs_by_plan_is_silent_and_the_others_go_on(gauntlet: Gauntlet) -> None:
    log = read_log(both(gauntlet, SMALL + SILENT))
    assert log.complete
    own: dict[str, list[int]] = {}
    for topic, message in log.records():
        own.setdefault(topic, []).append(message.step)
    assert own["estimate/e2"] == own["tx/e2/exchange"] == list(range(CRASH))
    assert own["tx/s3/measurement"] == list(range(HANG))
    assert own["estimate/e1"] == own["estimate/e3"] == own["rx/e2/correct"] == list(range(40))
    for topic, message in log.records():
        if topic == "channel/exchange" and isinstance(message, ChannelEvents):
            sent = dict(zip(message.link, message.sent, strict=True))
            assert sent["e2->e1"] == (message.step < CRASH)
            assert sent["e1->e2"] == 1


def test_a_planned_silence_is_told_and_no_estimate_counts_as_missing(gauntlet: Gauntlet) -> None:
    run = gauntlet.run(gauntlet.write(SMALL + SILENT + "expect: {missing_estimates: 0}\n"))
    assert run.process.returncode == 0, run.errors
    assert run.score()["complete"]
    assert "fell silent by plan" in run.output[0]
    assert {node["name"]: node["silent_from"] for node in run.score()["nodes"]}["e2"] == CRASH


def test_triggers_act_one_step_after_what_they_watch(gauntlet: Gauntlet) -> None:
    log = read_log(both(gauntlet, SMALL + TRIGGERED))
    truth: list[float] = []
    alarms: list[float] = []
    watched: dict[str, list[float]] = {}
    acted: dict[str, set[int]] = {"crossing": set(), "answer": set()}
    for topic, message in log.records():
        if isinstance(message, Truth):
            truth.append(message.state[0])
        elif isinstance(message, Estimate) and topic == "estimate/e2":
            alarms.append(float(sum(message.detector_alarm)))
        elif isinstance(message, Transmission) and topic.endswith(keys.WATCH):
            watched.setdefault(topic, []).append(message.values[0])
        elif isinstance(message, ChannelEvents):
            for stage in message.event_stage:
                if stage in acted:
                    acted[stage].add(message.step)
    assert watched == {"tx/e2/watch": alarms, "tx/plant/watch": truth}
    crossings = [
        step for step in range(1, 40) if (truth[step - 1] < 0.5) != (truth[step] < 0.5) or truth[step] == 0.5
    ]
    assert acted["crossing"] == {step + lag for step in crossings for lag in (1, 2, 3) if step + lag < 40}
    assert acted["answer"] == {
        step + lag for step, raised in enumerate(alarms) for lag in (1, 2) if raised and step + lag < 40
    }
    assert acted["crossing"]
    assert acted["answer"]


def test_a_forged_packet_of_a_sender_with_a_key_is_refused_and_counted_on_both_sides(
    gauntlet: Gauntlet,
) -> None:
    log = read_log(both(gauntlet, SMALL + TRIGGERED))
    refused: dict[str, int] = {}
    told: dict[str, int] = {}
    for topic, message in log.records():
        if isinstance(message, ChannelEvents) and message.refused:
            for link, count in zip(message.link, message.refused, strict=True):
                receiver = link.partition("->")[2]
                refused[receiver] = refused.get(receiver, 0) + count
        elif isinstance(message, Estimate):
            told[topic.partition("/")[2]] = told.get(topic.partition("/")[2], 0) + message.refused
    assert refused["e1"] > 0
    assert {name: count for name, count in told.items() if count} == {
        name: count for name, count in refused.items() if count
    }


@pytest.mark.parametrize("backend", ["processes", "inprocess"])
def test_everything_that_was_sent_has_one_fate(gauntlet: Gauntlet, backend: str) -> None:
    gauntlet.log(gauntlet.write(SMALL + TRIGGERED), "--backend", backend, out="run")
    balance: dict[str, int] = {}
    for _, message in read_log(gauntlet.home / "run" / "run.mcap").records():
        if not isinstance(message, ChannelEvents):
            continue
        zeros = [0] * len(message.link)
        columns = (message.sent, message.injected or zeros, message.duplicated or zeros)
        fates = (message.delivered, message.lost, message.refused or zeros)
        for number, link in enumerate(message.link):
            balance[link] = balance.get(link, 0) + sum(column[number] for column in columns)
            balance[link] -= sum(column[number] for column in fates)
            assert balance[link] == (message.in_flight or zeros)[number]
