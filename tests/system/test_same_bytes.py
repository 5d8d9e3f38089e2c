"""Same seed, same bytes: whatever the backend, the load, who starts first, or who is stopped for a while."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from bus.plan import Plan
from orchestrator.backends import processes
from orchestrator.log.reader import read_log
from orchestrator.run import run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.topology.load import load_topology
from tests.system.conftest import Gauntlet

CASE_B = Path(__file__).parents[2] / "topologies" / "ding2021" / "case_b.yaml"


@contextmanager
def busy_loops(count: int) -> Iterator[None]:
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait(timeout=10.0)


def test_one_process_or_many_writes_the_same_bytes(gauntlet: Gauntlet) -> None:
    many = gauntlet.log(CASE_B, out="many")
    one = gauntlet.log(CASE_B, "--backend", "inprocess", out="one")
    assert len(many) > 100_000
    assert many == one


def test_two_runs_and_one_beside_busy_loops_write_the_same_bytes(gauntlet: Gauntlet) -> None:
    topology = gauntlet.write()
    first = gauntlet.log(topology, out="first")
    second = gauntlet.log(topology, out="second")
    with busy_loops(2):
        loaded = gauntlet.log(topology, out="loaded")
    assert first == second == loaded


def test_another_seed_writes_other_bytes(gauntlet: Gauntlet) -> None:
    topology = gauntlet.write()
    own = gauntlet.log(topology, "--backend", "inprocess", out="own")
    assert own != gauntlet.log(topology, "--backend", "inprocess", "--seed", "8", out="other")


def test_window_deadline_and_place_leave_no_trace_in_the_log(gauntlet: Gauntlet) -> None:
    own = gauntlet.log(gauntlet.write(), "--backend", "inprocess", out="own")
    (gauntlet.home / "elsewhere").mkdir()
    moved = gauntlet.write(name="elsewhere/topology.yaml")
    overrides = ("--set", "process.window=3", "--set", "process.stall_s=12")
    assert own == gauntlet.log(moved, "--backend", "inprocess", *overrides, out="other")


def test_the_resolved_topology_runs_to_the_same_bytes(gauntlet: Gauntlet) -> None:
    own = gauntlet.log(gauntlet.write(), "--backend", "inprocess", "--set", "steps=20", out="own")
    assert own == gauntlet.log(gauntlet.home / "own" / "topology.yaml", "--backend", "inprocess", out="again")


def test_nodes_that_start_in_another_order_write_the_same_bytes(
    gauntlet: Gauntlet, monkeypatch: pytest.MonkeyPatch
) -> None:
    reference = gauntlet.log(gauntlet.write(), "--backend", "inprocess", out="reference")
    in_order = processes.process_names

    def reversed_names(plan: Plan) -> tuple[str, ...]:
        return tuple(reversed(in_order(plan)))

    monkeypatch.setattr(processes, "process_names", reversed_names)
    topology = load_topology(gauntlet.home / "topology.yaml")
    directory = make_run_directory(gauntlet.home / "reversed", "small", 7)
    report = run_topology(topology, directory, "processes", lambda recorded: None)
    assert not report.message
    assert (directory / "run.mcap").read_bytes() == reference


def test_a_process_that_is_stopped_for_15_s_and_continued_changes_nothing(
    gauntlet: Gauntlet, slow_topology: Path
) -> None:
    reference = gauntlet.log(slow_topology, "--backend", "inprocess", out="reference")
    launched = gauntlet.launch(slow_topology)
    stopped = launched.wait_for_nodes(10)["channel"]
    launched.wait_for_log(4_000)
    os.kill(stopped, signal.SIGSTOP)
    time.sleep(15.0)
    assert launched.process.poll() is None, "the run must wait for the stopped process"
    os.kill(stopped, signal.SIGCONT)
    assert launched.finish() == 0, launched.errors
    assert (launched.out / "run.mcap").read_bytes() == reference


def test_another_estimator_in_one_place_leaves_all_other_draws_as_they_were(gauntlet: Gauntlet) -> None:
    topology = gauntlet.write()
    gauntlet.log(topology, "--backend", "inprocess", out="own")
    gauntlet.log(topology, "--backend", "inprocess", "--set", "estimators.e3.method=kalman", out="changed")
    own, changed = (
        {
            (topic, message.step): message
            for topic, message in read_log(gauntlet.home / name / "run.mcap").records()
        }
        for name in ("own", "changed")
    )
    drawn = [key for key in own if key[0].startswith(("truth/", "tx/s", "rx/")) and "/exchange" not in key[0]]
    assert len(drawn) == 40 * (1 + 4 + 4)
    assert all(own[key] == changed[key] for key in drawn)
    fates_own, fates_changed = (
        {
            (message.step, link): lost
            for (topic, _), message in record.items()
            if topic == "channel/exchange"
            for link, lost in zip(message.link, message.lost, strict=True)
        }
        for record in (own, changed)
    )
    assert 0 < len(fates_changed) < len(fates_own), "e3 has left the exchange"
    assert all(fates_own[key] == lost for key, lost in fates_changed.items())


def test_networks_of_unlike_rounds_write_the_same_bytes_in_one_process_and_in_many(
    gauntlet: Gauntlet,
) -> None:
    """Three rounds of one family may be over before the second of another."""
    topology = gauntlet.write(
        """
name: unlike-rounds
period_s: 0.1
steps: 20
plant: {model: linear, A: [[0.9]], process_noise: {std: 0.1}, initial: {std: 1.0}}
sensors: {s1..s2: {model: linear, C: [[1.0]], noise: {std: 0.3}}}
estimators:
  d1..d2: {method: diffusion_kalman}
  i1..i2: {method: information_consensus, rounds_per_step: 3}
  q1..q2: {method: kalman_consensus}
graph: {complete: {nodes: 2}}
channel: {"*->*": {bernoulli: {loss: 0.2}}}
"""
    )
    one = gauntlet.log(topology, "--backend", "inprocess", out="one")
    assert gauntlet.log(topology, out="many") == one
