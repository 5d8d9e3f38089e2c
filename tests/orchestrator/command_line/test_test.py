"""`gauntlet test`: what it prints, writes and answers with."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.command_line.conftest import PATIENCE_S, ROOT, Command
from tests.orchestrator.testing.conftest import RAISING, check_junit

STRICT = "extends: small.yaml\nexpect: {rmse.position: {node: e1, at_most: 0.001}}\n"


def test_files_that_keep_their_promises_pass(gauntlet: Command, home: Path) -> None:
    answer = gauntlet("test", ".", "--junit", "reports/junit.xml")
    assert answer.code == 0, answer.out
    assert "✓ small.yaml: 1 held" in answer.out
    assert "1 file, 1 expectation: 1 held, 0 failed" in answer.out
    root = check_junit((home / "reports/junit.xml").read_bytes())
    assert [suite.attrib["name"] for suite in root] == ["small.yaml"]


def test_a_broken_promise_fails_with_its_numbers_and_its_log(gauntlet: Command, home: Path) -> None:
    (home / "strict.yaml").write_text(STRICT)
    answer = gauntlet("test", ".", "--junit", "junit.xml", "--logs", "kept", "-j", "2")
    assert answer.code == 1
    assert "✓ small.yaml" in answer.out
    assert "✗ strict.yaml: 1 of 2 failed" in answer.out
    assert "rmse.position at most 0.001: 0." in answer.out
    (log,) = (home / "kept").glob("*/run.mcap")
    assert f"log: {log.relative_to(home)}" in answer.out
    assert len(list(check_junit((home / "junit.xml").read_bytes()).iter("failure"))) == 1


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("extends: small.yaml\nsteppes: 3\n", 2, "did you mean 'steps'"),
        (
            "extends: small.yaml\nestimators: {e2: {method: './raising.py:Raising'}}\n",
            3,
            "e2 failed in step 7",
        ),
    ],
)
def test_what_comes_to_no_verdict_says_why(
    gauntlet: Command, home: Path, text: str, code: int, words: str
) -> None:
    (home / "raising.py").write_text(RAISING)
    (home / "bad.yaml").write_text(text)
    answer = gauntlet("test", "bad.yaml", "small.yaml", "--logs", "kept")
    assert answer.code == code
    assert "! bad.yaml: no verdict" in answer.out
    assert words in answer.out
    assert "✓ small.yaml" in answer.out, "the others are run all the same"


def test_a_file_without_expectations_is_reported_as_such(gauntlet: Command, home: Path) -> None:
    (home / "silent.yaml").write_text("extends: small.yaml\nexpect: null\n")
    answer = gauntlet("test", "silent.yaml")
    assert answer.code == 0
    assert "- silent.yaml: it states no expectation" in answer.out
    assert "1 state none" in answer.out


def test_a_pattern_chooses_files_and_one_that_fits_none_is_refused(gauntlet: Command, home: Path) -> None:
    (home / "strict.yaml").write_text(STRICT)
    assert gauntlet("test", ".", "-k", "small").code == 0
    refused = gauntlet("test", ".", "-k", "large")
    assert refused.code == 2
    assert "choose another -k" in refused.err
    assert gauntlet("test", "nowhere").code == 2


def test_a_report_that_cannot_be_written_is_told(gauntlet: Command, home: Path) -> None:
    (home / "file").touch()
    answer = gauntlet("test", "small.yaml", "--junit", "file/junit.xml")
    assert answer.code == 2
    assert "choose another --junit" in answer.err


def test_a_folder_for_logs_that_cannot_be_made_is_told_by_its_own_option(
    gauntlet: Command, home: Path
) -> None:
    (home / "file").touch()
    answer = gauntlet("test", "small.yaml", "--logs", "file/logs")
    assert answer.code == 3
    assert "file/logs: Not a directory; choose another --logs" in answer.out


def test_a_folder_of_this_repository_keeps_its_promises(gauntlet: Command) -> None:
    folder = ROOT / "topologies/sadeghzadeh2022"
    answer = gauntlet("test", folder)
    assert answer.code == 0, answer.out
    assert f"{len(list(folder.glob('[!_]*.yaml')))} files" in answer.out


@pytest.mark.slow
def test_every_topology_of_this_repository_keeps_its_promises(gauntlet: Command) -> None:
    answer = gauntlet("test", ROOT / "topologies", "-j", "2")
    assert answer.code == 0, answer.out


def test_a_signal_ends_the_suite_and_all_its_workers(
    gauntlet_process: Callable[..., subprocess.Popen[str]], home: Path
) -> None:
    for name in ("long", "longer"):
        (home / f"{name}.yaml").write_text("extends: small.yaml\nsteps: 50000\n")
    suite = gauntlet_process("test", "long.yaml", "longer.yaml", "-j", "2", "--logs", "kept")
    children = Path(f"/proc/{suite.pid}/task/{suite.pid}/children")
    running = _eventually(
        lambda: len(list(home.glob("kept/*/run.mcap"))) == 2 and children.read_text().split()
    )
    suite.send_signal(signal.SIGTERM)
    _, said = suite.communicate(timeout=PATIENCE_S)
    assert suite.returncode == 128 + signal.SIGTERM
    assert "interrupted by SIGTERM" in said
    assert len(running) >= 2
    _eventually(lambda: not any(Path(f"/proc/{child}").exists() for child in running))


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_interrupted_suite_reports_what_is_finished_and_marks_the_rest(
    gauntlet_process: Callable[..., subprocess.Popen[str]], home: Path, jobs: int
) -> None:
    for name in ("long", "longer"):
        (home / f"{name}.yaml").write_text(f"extends: small.yaml\nname: {name}\nsteps: 50000\n")
    (home / "short.yaml").write_text("extends: small.yaml\n")
    files, last = ["small.yaml", "long.yaml", "longer.yaml"], "long"
    if jobs == 2:  # one worker is at the long file while the other goes through the rest
        files, last = ["long.yaml", "small.yaml", "short.yaml", "longer.yaml"], "longer"
    options = ("-j", str(jobs), "--logs", "kept", "--junit", "junit.xml")
    suite = gauntlet_process("test", *files, *options, start_new_session=True)
    _eventually((home / "kept" / f"{last}-seed7-1" / "run.mcap").exists)
    os.killpg(suite.pid, signal.SIGINT)  # as a terminal does: the workers get it too
    told, said = suite.communicate(timeout=PATIENCE_S)
    assert suite.returncode == 128 + signal.SIGINT
    assert said == "gauntlet: interrupted by SIGINT\n"
    assert f"{len(files)} files" in told
    root = check_junit((home / "junit.xml").read_bytes())
    errors = {suite.attrib["name"]: [error.attrib for error in suite.iter("error")] for suite in root}
    assert list(errors) == files
    assert [name for name, found in errors.items() if found] == ["long.yaml", "longer.yaml"]
    for name in ("long.yaml", "longer.yaml"):
        (error,) = errors[name]
        assert error["type"] == "interrupted"
        assert "interrupted by SIGINT" in error["message"]


def _eventually(condition: Callable[[], Any]) -> Any:
    """Wait for something to be true, and return it."""
    end = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < end
        time.sleep(0.05)
    return found
