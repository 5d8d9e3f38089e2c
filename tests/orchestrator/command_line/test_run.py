"""`gauntlet run`: what it writes, prints and returns."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from orchestrator.log.reader import read_log
from tests.orchestrator.command_line.conftest import PATIENCE_S, SMALL, Command

BEGINNERS_RUN = ("run", "small.yaml", "--backend", "inprocess")

SLOW_PLUGIN = """
import pathlib, time

class Slow:
    rounds = 0

    def __init__(self, setting):
        pathlib.Path("loading").touch()
        time.sleep(60)
"""


def test_a_run_writes_its_files_and_tells_where(gauntlet: Command, home: Path) -> None:
    answer = gauntlet(*BEGINNERS_RUN, "--out", "out")
    assert answer.code == 0
    assert answer.out.startswith("PASSED: ")
    for name in ("run.mcap", "score.json", "timing.json", "topology.yaml"):
        assert (home / "out" / name).is_file()
        assert f"out/{name}" in answer.out
    assert read_log(home / "out" / "run.mcap").complete


def test_progress_goes_to_standard_error(gauntlet: Command) -> None:
    answer = gauntlet(*BEGINNERS_RUN)
    assert answer.err.splitlines()[-1] == "step 24 of 24"
    assert "step 24 of 24" not in answer.out


def test_json_is_all_that_stands_on_standard_output(gauntlet: Command, home: Path) -> None:
    answer = gauntlet(*BEGINNERS_RUN, "--out", "out", "--json")
    facts = answer.json()
    assert not answer.err
    assert (facts["exit_code"], facts["message"], facts["directory"]) == (0, "", "out")
    assert facts["score"] == json.loads((home / "out" / "score.json").read_text())
    assert facts["timing"]["backend"] == "inprocess"
    assert set(facts["timing"]) == set(json.loads((home / "out" / "timing.json").read_text()))


def test_a_failed_expectation_is_exit_code_1(gauntlet: Command) -> None:
    answer = gauntlet(*BEGINNERS_RUN, "--set", "expect.divergences=3")
    assert answer.code == 1
    assert answer.out.startswith("FAILED: 1 of 1 expectation failed (divergences)")


def test_a_failing_node_is_exit_code_3_and_told_in_json_too(gauntlet: Command, home: Path) -> None:
    plugin = Path(__file__).parents[2] / "system" / "plugins" / "misbehaving.py"
    text = SMALL.replace(
        "e1..e3: {method: secure_distributed, coupling: 0.01}",
        f"e1..e3: {{method: '{plugin}:Misbehaving', fault: raise, at: 5}}",
    )
    (home / "faulty.yaml").write_text(text.replace("e*->e*:", "s*->e*:"))
    answer = gauntlet("run", "faulty.yaml", "--backend", "inprocess", "--json")
    assert answer.code == 3
    facts = answer.json()
    assert facts["exit_code"] == 3
    assert "failed in step 5: ZeroDivisionError" in facts["message"]
    assert not facts["score"]["complete"]
    assert "Traceback" in answer.err


def test_overrides_and_seed_reach_the_run(gauntlet: Command, home: Path) -> None:
    answer = gauntlet(*BEGINNERS_RUN, "--set", "steps=5", "--set", "attacks=null", "--seed", "11")
    assert answer.code == 0
    log = read_log(home / "runs" / "small-seed11-1" / "run.mcap")
    assert (log.provenance["steps"], log.provenance["seed"]) == ("5", "11")
    assert "bias" not in log.topology_json.decode()


def test_runs_without_a_place_are_numbered(gauntlet: Command, home: Path) -> None:
    for _ in range(2):
        gauntlet(*BEGINNERS_RUN)
    assert sorted(path.name for path in (home / "runs").iterdir()) == ["small-seed7-1", "small-seed7-2"]


def test_warnings_go_to_standard_error(gauntlet: Command, home: Path) -> None:
    overruled = SMALL.replace("  e*->e*:", "  e1->e2: perfect\n  e*->e*:")
    (home / "odd.yaml").write_text(overruled)
    answer = gauntlet("run", "odd.yaml", "--backend", "inprocess")
    assert answer.code == 0
    assert answer.err.startswith("warning: odd.yaml:13: ")
    assert "warning: " not in answer.out


def test_all_mistakes_are_told_at_once_before_anything_is_written(gauntlet: Command, home: Path) -> None:
    text = SMALL.replace("steps: 24", "stepz: 24").replace("failure: 0.2", "failure: 2")
    (home / "bad.yaml").write_text(text)
    answer = gauntlet("run", "bad.yaml")
    assert answer.code == 2
    assert "bad.yaml:5: " in answer.err
    assert "bad.yaml:13: " in answer.err
    assert "did you mean 'steps'?" in answer.err
    assert not answer.out
    assert not (home / "runs").exists()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("run", "smal.yaml"), "smal.yaml: there is no such file\n    did you mean 'small.yaml'?"),
        (("run", "."), "name a file in it"),
        (("run", "small.yaml", "--set", "stepz=3"), "did you mean 'steps'?"),
        (("run", "small.yaml", "--set", "steps"), "--set"),
        (("run", "small.yaml", "--out", "small.yaml"), "small.yaml is a file; choose a directory as --out"),
        (("run", "small.yaml", "--out", "small.yaml/out"), "choose another --out"),
    ],
    ids=["no such file", "a directory", "no such key", "no value", "out is a file", "out below a file"],
)
def test_input_that_cannot_be_used_is_told_with_its_cure(
    gauntlet: Command, arguments: tuple[str, ...], complaint: str
) -> None:
    answer = gauntlet(*arguments)
    assert answer.code == 2
    assert complaint in answer.err
    assert "Traceback" not in answer.err
    assert not answer.out


def test_a_directory_that_may_not_be_written_is_bad_input(gauntlet: Command, home: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    (home / "mine").mkdir(mode=0o500)
    for out in ("mine", "mine/out"):
        answer = gauntlet(*BEGINNERS_RUN, "--out", out)
        assert answer.code == 2
        assert "Permission denied; choose another --out" in answer.err


def test_a_base_is_not_run_but_leads_to_what_is(gauntlet: Command, home: Path) -> None:
    (home / "_base.yaml").write_text(SMALL)
    answer = gauntlet("run", "_base.yaml")
    assert answer.code == 2
    assert "is a base for other topologies" in answer.err
    assert "small.yaml" in answer.err


@pytest.mark.parametrize(("asked", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_before_the_start_leaves_nothing(
    gauntlet_process: Callable[..., subprocess.Popen[str]], home: Path, asked: signal.Signals, code: int
) -> None:
    (home / "slow.py").write_text(SLOW_PLUGIN)
    (home / "slow.yaml").write_text(
        SMALL.replace("{method: secure_distributed, coupling: 0.01}", "{method: './slow.py:Slow'}")
    )
    process = gauntlet_process("run", "slow.yaml")
    deadline = time.monotonic() + PATIENCE_S
    while not (home / "loading").exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(asked)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == code
    assert (out, err) == ("", f"gauntlet: interrupted by {asked.name}\n")
    assert not (home / "runs").exists()


def test_a_reader_who_leaves_does_not_end_the_run(
    gauntlet_process: Callable[..., subprocess.Popen[str]], home: Path
) -> None:
    process = gauntlet_process(*BEGINNERS_RUN, "--out", "out", "--set", "expect.divergences=3")
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    process.stderr.close()
    assert process.wait(timeout=PATIENCE_S) == 1, "the exit code is still that of the verdict"
    assert read_log(home / "out" / "run.mcap").complete
