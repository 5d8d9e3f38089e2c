"""A disk that fills up: exit code 3, a message with the cure, and what was written stays readable."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from orchestrator.log.reader import read_log
from orchestrator.log.writer import CHUNK_STEPS
from tests.orchestrator.command_line.conftest import PATIENCE_S, Command

STEPS = 400
ROOM_BYTES = 64 * 1024


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of a few pages."""
    if sys.platform != "linux" or os.geteuid() != 0:
        pytest.skip("only root can mount a small file system")
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={ROOM_BYTES}", "tmpfs", str(place)]
    mounted = subprocess.run(mount, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    if mounted.returncode:
        pytest.skip(f"no file system can be mounted here: {mounted.stderr.strip()}")
    yield place
    subprocess.run(["umount", str(place)], timeout=PATIENCE_S, check=True)


def check_what_is_left(log_file: Path, complaint: str, message: str) -> None:
    """The message names the file, the reason, how far it came and the cure; the log holds at least that.

    The last chunk may be whole although what follows it did not fit.
    """
    log = read_log(log_file)
    steps = [step for step, _ in log.steps()]
    assert log.truncated
    assert steps == list(range(len(steps)))
    assert 0 < len(steps) < STEPS
    told = re.search(r"it holds at least the steps before (\d+); ", message)
    assert told is not None
    assert len(steps) - CHUNK_STEPS <= int(told[1]) <= len(steps)
    assert f"{log_file} cannot be written: {complaint}; it holds" in message
    assert "free some space or write to another disk, then run again" in message


@pytest.mark.parametrize("backend", ["inprocess", "processes"])
def test_a_full_disk_ends_the_run_and_keeps_what_was_recorded(
    gauntlet: Command, small_disk: Path, backend: str
) -> None:
    out = small_disk / "out"
    answer = gauntlet("run", "small.yaml", "--backend", backend, "--set", f"steps={STEPS}", "--out", out)
    assert answer.code == 3
    assert "Traceback" not in answer.err
    check_what_is_left(out / "run.mcap", "No space left on device", answer.err)
    assert answer.out.startswith("INCOMPLETE: ")
    again = gauntlet("score", out / "run.mcap")
    assert again.code == 1
    assert again.out.splitlines()[0] == answer.out.splitlines()[0]
    score = out / "score.json"
    assert not score.exists() or score.read_bytes().endswith(b"}\n"), "no half of a score is left behind"


def test_a_disk_that_is_full_from_the_beginning_is_told_with_its_cure(
    gauntlet: Command, small_disk: Path
) -> None:
    out = small_disk / "out"
    out.mkdir()
    with pytest.raises(OSError, match="No space left"):
        (small_disk / "ballast").write_bytes(bytes(2 * ROOM_BYTES))
    answer = gauntlet("run", "small.yaml", "--backend", "inprocess", "--out", out)
    assert answer.code == 3
    assert (
        f"gauntlet: {out}/topology.yaml cannot be written: No space left on device; free some" in answer.err
    )
    assert "Traceback" not in answer.err
    assert not answer.out
    assert not list(out.glob("*.*")), "another run may use the directory"


@pytest.mark.parametrize("limit", [ROOM_BYTES, 2_000, 200])
def test_a_limit_on_the_size_of_files_is_told_as_a_full_disk_is(
    gauntlet_process: Callable[..., subprocess.Popen[str]], home: Path, limit: int
) -> None:
    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    arguments = ("run", "small.yaml", "--backend", "inprocess", "--set", f"steps={STEPS}", "--out", "out")
    process = gauntlet_process(*arguments, preexec_fn=limited)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 3
    assert "Traceback" not in err
    if limit == ROOM_BYTES:
        check_what_is_left(Path("out/run.mcap"), "File too large", err)
        assert out.startswith("INCOMPLETE: ")
    else:
        assert "cannot be written: File too large; " in err
        assert "free some space" in err
        assert not out
