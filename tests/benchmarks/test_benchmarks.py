"""The benchmark's own parts: right values, fair shapes, bounded waits, and rows that say what is missing."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import ring
from benchmarks.__main__ import parse
from benchmarks.comparison import Comparison, at_least, at_most
from benchmarks.contest import Contestant, interleave, ours, run_once
from benchmarks.networks import geometric, network, write_shape
from benchmarks.table import markdown
from bus.messages import Estimate, Message
from orchestrator.backends.inprocess import run_messages
from orchestrator.topology.load import load_topology

STEPS = 40


def ring_by_numpy(nodes: int, steps: int) -> np.ndarray:
    state = np.zeros(nodes)
    for step in range(steps):
        mean = (np.roll(state, 1) + np.roll(state, 2) + np.roll(state, -1) + np.roll(state, -2)) / 4.0
        state = 0.9 * mean + np.sin(step * np.arange(1, nodes + 1))
    return state


def test_our_ring_computes_what_numpy_computes() -> None:
    last: dict[str, Message] = {}
    plan = load_topology(ring.TOPOLOGY, (f"steps={STEPS}",)).plan
    run_messages(plan, lambda topic, message: last.update({topic: message}))
    final = [last[f"estimate/e{number}"] for number in range(1, ring.NODES + 1)]
    values = [message.state[0] for message in final if isinstance(message, Estimate)]
    np.testing.assert_allclose(values, ring_by_numpy(ring.NODES, STEPS), rtol=1e-12, atol=1e-12)


def test_the_ring_of_the_benchmark_is_that_of_the_references() -> None:
    (recorded,) = (each for each in ring.contestants(STEPS) if each.name == "ring, one process with log")
    figures = run_once(recorded, timeout_s=60.0)  # it checks the values in the log
    assert figures["steps"] == STEPS
    assert figures["steps_per_s"] > 0.0
    assert figures["cpu_ms_per_step"] > 0.0


def test_a_ring_of_wrong_values_is_no_result() -> None:
    command = ours(ring.TOPOLOGY, "inprocess", steps=STEPS)
    with pytest.raises(RuntimeError, match="the ring computed wrong values"):
        run_once(Contestant("the ring", command, check=lambda out: "wrong values"), timeout_s=60.0)


def test_the_bare_network_has_the_shape_of_ours(tmp_path: Path) -> None:
    topology, shape = tmp_path / "network.yaml", tmp_path / "shape.json"
    topology.write_text(network(10, STEPS, geometric(10)))
    write_shape(topology, 5, shape)
    told = json.loads(shape.read_text())
    plan = load_topology(topology).plan
    assert [len(near) for near in told["neighbours"]] == [len(own.neighbours) for own in plan.estimators]
    messages: list[str] = []
    run_messages(load_topology(topology, ("steps=5",)).plan, lambda topic, message: messages.append(topic))
    assert len(messages) == 5 * (1 + 5 * 10 + 2)  # as `null_messages.Run.messages_per_step` says
    assert set(told["bytes"]) == {
        "truth", "slot", "correct", "exchange_slot", "exchange", "estimate", "event",
    }  # fmt: skip


def test_all_rows_are_measured_unless_some_are_named() -> None:
    assert parse([]).rows == []
    assert parse(["a", "c", "--quick"]).rows == ["a", "c"]
    with pytest.raises(SystemExit):
        parse(["z"])


def test_a_ratio_is_held_against_what_is_wanted() -> None:
    faster = Comparison("a", "rate", "steps/s", [30.0, 20.0, 10.0], "other", [9.0, 10.0], at_least(2.0))
    assert faster.ratio == pytest.approx(20.0 / 9.5)
    assert faster.met
    assert not Comparison("b", "start-up", "s", [2.0], "other", [1.0], at_most(1.5)).met
    assert Comparison("d", "memory", "MiB", [2.0], "other", [1.0]).met is None


def test_what_is_not_installed_is_told_in_its_row() -> None:
    absent = Contestant("other", ("false",), needs=("no_such_module_anywhere",))
    found = interleave([absent], repeats=1, timeout_s=1.0, tell=lambda text: None)["other"]
    row = Comparison("e", "ring", "steps/s", [1.0], "other", found.samples("rate"), note=found.failure)
    assert "no_such_module_anywhere missing: pip install -e '.[bench]'" in markdown([row], 1)


def test_what_fails_or_hangs_is_ended_and_told() -> None:
    failing = Contestant("failing", (sys.executable, "-c", "raise SystemExit('no luck')"))
    hanging = Contestant("hanging", (sys.executable, "-c", "import time; time.sleep(60)"))
    found = interleave([failing, hanging], repeats=2, timeout_s=1.0, tell=lambda text: None)
    assert found["failing"].failure == "failing failed: no luck"
    assert found["hanging"].failure == "hanging did not end within 1 s"
