"""What is promised when a process fails, dies, hangs or is asked to end; and that nothing is left behind."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

from orchestrator.evidence.sources import load_source
from orchestrator.handoff import load
from orchestrator.log.reader import read_log
from orchestrator.report.recording import read_recording
from tests.system.conftest import PLUGIN, SMALL, Gauntlet, process_exists, wait_until

PROCESSES = 10  # plant, 4 sensors, 4 estimators, channel


def with_fault(gauntlet: Gauntlet, fault: str) -> Path:
    faulty = (
        f"  e1..e3: {{method: kalman}}\n  e4: {{method: '{PLUGIN}:Misbehaving', fault: {fault}, at: 20}}\n"
    )
    text = SMALL.replace("  e1..e4: {method: secure_distributed, coupling: 0.01}\n", faulty)
    return gauntlet.write(text.replace("  e*->e*: [{gilbert_elliott: {failure: 0.2, recovery: 0.5}}]\n", ""))


def recorded_steps(out: Path) -> int:
    """The number of steps in the log, read by the log library's own reader."""
    with (out / "run.mcap").open("rb") as stream:
        return len(
            {message.sequence for _, _, message in make_reader(stream).iter_messages(topics=["truth/plant"])}
        )


@pytest.mark.parametrize("backend", ["processes", "inprocess"])
def test_what_a_node_raises_is_shown_with_its_name_and_step_and_ends_the_run(
    gauntlet: Gauntlet, backend: str
) -> None:
    run = gauntlet.run(with_fault(gauntlet, "raise"), "--backend", backend)
    assert run.process.returncode == 3
    assert "e4 failed in step 20: ZeroDivisionError: the gain has vanished" in run.errors
    assert "misbehaving.py" in run.errors, "the traceback names the user's file"
    assert not run.score()["complete"]
    assert recorded_steps(run.out) >= 20


@pytest.mark.parametrize("backend", ["processes", "inprocess"])
def test_a_detection_with_swapped_fields_ends_the_run_with_the_name_of_the_field(
    gauntlet: Gauntlet, backend: str
) -> None:
    run = gauntlet.run(with_fault(gauntlet, "swap"), "--backend", backend)
    assert run.process.returncode == 3
    assert "e4 failed in step 20: TypeError: detections[0].source must be text, got 20 (int)" in run.errors
    assert not run.score()["complete"]
    assert recorded_steps(run.out) >= 20


def test_an_estimator_that_diverges_does_not_end_the_run(gauntlet: Gauntlet) -> None:
    run = gauntlet.run(with_fault(gauntlet, "diverge"))
    assert run.process.returncode == 0, run.errors
    score = run.score()
    assert score["complete"]
    assert {node["name"]: node["divergence_step"] for node in score["nodes"]}["e4"] == 20


def test_a_node_that_leaves_early_is_noticed(gauntlet: Gauntlet) -> None:
    run = gauntlet.run(with_fault(gauntlet, "exit"))
    assert run.process.returncode == 3
    assert "e4" in run.errors


def test_a_killed_node_is_noticed_within_a_second(gauntlet: Gauntlet, slow_topology: Path) -> None:
    run = gauntlet.launch(slow_topology)
    victim = run.wait_for_nodes(PROCESSES)["s3"]
    run.wait_for_log(4_000)
    os.kill(victim, signal.SIGKILL)
    killed_at = time.monotonic()
    assert run.finish() == 3
    assert time.monotonic() - killed_at < 1.0 + 4.0, "noticed within 1 s, and the others given time to end"
    assert "s3 was killed by signal 9" in run.errors
    assert not run.score()["complete"]


@pytest.mark.parametrize("victim", ["s3", "e3", "e1"])
def test_a_run_goes_on_without_a_killed_node_when_the_topology_says_so(
    gauntlet: Gauntlet, victim: str
) -> None:
    fast = "  e1..e4: {method: secure_distributed, coupling: 0.01}\n"
    slow = f"  e1: {{method: '{PLUGIN}:Misbehaving', pause_s: 0.1}}\n" + fast.replace("e1..e4", "e2..e4")
    text = SMALL.replace(fast, slow)
    run = gauntlet.launch(gauntlet.write(text), "--set", "process.on_crash={s*: silence, e*: silence}")
    pid = run.wait_for_nodes(PROCESSES)[victim]
    run.wait_for_log(4_000)
    os.kill(pid, signal.SIGKILL)
    assert run.finish() == 0, run.errors
    score = run.score()
    assert score["complete"]
    (name, step), *others = score["departed"].items()
    assert (name, others) == (victim, [])
    assert 0 < step < 40
    assert f"though the run lost {victim} in step {step}" in " ".join(run.output[0].split())
    assert recorded_steps(run.out) == 40
    log = read_log(run.out / "run.mcap")
    assert log.complete
    topic = f"tx/{victim}/measurement" if victim.startswith("s") else f"estimate/{victim}"
    assert [message.step for at, message in log.records() if at == topic] == list(range(step))
    again = gauntlet.call("score", run.out / "run.mcap", "--json")
    assert again.stdout.encode() == (run.out / "score.json").read_bytes()


def test_what_a_node_raises_ends_no_run_that_may_go_on_without_it(gauntlet: Gauntlet) -> None:
    run = gauntlet.run(with_fault(gauntlet, "raise"), "--set", "process.on_crash={e4: silence}")
    assert run.process.returncode == 0, run.errors
    assert run.score()["departed"] == {"e4": 20}
    verdict = (run.out / "score.json").read_bytes()
    assert load(run.out).score.to_json() == verdict
    assert read_recording(run.out / "run.mcap").score.to_json() == verdict
    assert load_source(run.out).table.column("complete").to_pylist() == [True] * 4


def test_a_hanging_node_is_named_with_the_slot_that_others_wait_for(gauntlet: Gauntlet) -> None:
    run = gauntlet.run(with_fault(gauntlet, "hang"), "--set", "process.stall_s=2")
    assert run.process.returncode == 3
    assert "e4 owes estimate/e4 of step 20" in run.errors


def test_a_stopped_node_is_named_as_stopped(gauntlet: Gauntlet, slow_topology: Path) -> None:
    run = gauntlet.launch(slow_topology, "--set", "process.stall_s=2")
    victim = run.wait_for_nodes(PROCESSES)["s3"]
    run.wait_for_log(4_000)
    os.kill(victim, signal.SIGSTOP)
    assert run.finish() == 3
    assert "e3 waits for slot" in run.errors
    assert "of s3->e3" in run.errors
    assert "s3 is stopped" in run.errors
    assert not process_exists(victim), "a stopped process cannot hear the asking; it is killed"


@pytest.mark.parametrize(("asked", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("backend", ["processes", "inprocess"])
def test_an_interrupted_run_closes_its_log_and_leaves_nobody(
    gauntlet: Gauntlet, slow_topology: Path, asked: signal.Signals, code: int, backend: str
) -> None:
    run = gauntlet.launch(slow_topology, "--backend", backend)
    run.wait_for_log(4_000)
    pids = run.pids()
    if asked == signal.SIGINT:
        os.killpg(run.process.pid, asked)  # a terminal's Ctrl-C reaches every process
    else:
        os.kill(run.process.pid, asked)
    asked_at = time.monotonic()
    assert run.finish() == code
    assert time.monotonic() - asked_at < 5.0
    assert "interrupted" in run.errors
    assert not any(map(process_exists, pids.values()))
    log = read_log(run.out / "run.mcap")
    assert not log.truncated
    assert not log.complete
    assert not run.score()["complete"]
    assert recorded_steps(run.out) > 0


def test_a_killed_orchestrator_leaves_no_orphan_and_a_readable_log(
    gauntlet: Gauntlet, slow_topology: Path
) -> None:
    run = gauntlet.launch(slow_topology, "--set", "steps=400")
    pids = run.wait_for_nodes(PROCESSES)
    run.wait_for_log(20_000)
    run.process.send_signal(signal.SIGKILL)
    run.process.wait(timeout=10.0)
    wait_until(lambda: not any(map(process_exists, pids.values())), 2.0, "the orphans are gone")
    log = read_log(run.out / "run.mcap")
    assert log.truncated
    steps = [message.step for topic, message in log.records() if topic == "truth/plant"]
    assert steps
    assert steps == list(range(len(steps)))


def test_two_runs_at_once_do_not_hear_each_other(gauntlet: Gauntlet) -> None:
    topology = gauntlet.write()
    runs = [gauntlet.launch(topology, out=f"run{number}") for number in range(2)]
    assert [run.finish() for run in runs] == [0, 0], runs[0].errors + runs[1].errors
    first, second = ((run.out / "run.mcap").read_bytes() for run in runs)
    assert first == second


def test_a_run_does_not_overwrite_another(gauntlet: Gauntlet) -> None:
    topology = gauntlet.write()
    before = gauntlet.log(topology, "--backend", "inprocess", out="out")
    again = gauntlet.run(topology, "--backend", "inprocess", out="out")
    assert again.process.returncode == 2
    assert "holds a run already" in again.errors
    assert (again.out / "run.mcap").read_bytes() == before


def test_runs_without_a_place_get_one_each(gauntlet: Gauntlet) -> None:
    topology = gauntlet.write()
    for _ in range(2):
        done = gauntlet.call("run", topology, "--backend", "inprocess")
        assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in (gauntlet.home / "runs").iterdir()) == [
        "small-seed7-1",
        "small-seed7-2",
    ]
