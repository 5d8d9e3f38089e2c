"""Small campaigns, in this process and through the command, every wait bounded."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from orchestrator.campaign.sweep import Request, prepare, sweep
from tests.playing import RING

ROOT = Path(__file__).parents[3]
PATIENCE_S = 90.0
COMMAND = [sys.executable, "-m", "orchestrator.command_line.app"]

SMALL = (
    RING.format(name="small", seed=7, steps=12)
    + """\
channel:
  e*->e*: {gilbert_elliott: {failure: 0.2, recovery: 0.5}}
attacks:
  - {bias: {value: 5.0}, on: s2->e2, steps: [4, 6]}
expect:
  rmse.position: {at_most: 0.15}
"""
)

MOODY = '''
import multiprocessing
import os
import signal
import time
from pathlib import Path

import numpy as np
from nodes.contract import Belief

BUSY = Path(__file__).with_name("busy")


class Moody:
    """Does something foolish in some trials: `temper` says what, and its own draw whether."""

    rounds = 0

    def __init__(self, setting, *, temper: str = "raise"):
        self.mean = setting.plant.initial_mean
        self.temper = temper
        self.is_bad = setting.rng.random() < 0.3

    def correct(self, step, packets):
        if step == 3 and self.is_bad and not (self.temper.endswith("while busy") and not BUSY.exists()):
            if self.temper == "raise":
                raise ValueError("not today")
            if self.temper.startswith("hang"):
                BUSY.with_name("hangs").touch()
                time.sleep(1000.0)
            if self.temper == "kill the parent":
                os.kill(multiprocessing.parent_process().pid, signal.SIGKILL)
                time.sleep(1000.0)
            if self.temper.startswith("fork") and os.fork() == 0:
                time.sleep(60.0)
                os._exit(0)
            if self.temper == "fork and hang":
                time.sleep(1000.0)
            os.kill(os.getpid(), signal.SIGKILL)

    def exchange(self, step, round_, packets): ...

    def estimate(self, step):
        return Belief(state=self.mean, covariance=np.eye(self.mean.size))
'''


@dataclass
class Heard:
    """What a campaign tells of its progress."""

    total: int = 0
    done: int = 0
    finished: list[int] = field(default_factory=list)
    failed: int = 0

    def begin(self, total: int, done: int) -> None:
        self.total, self.done = total, done

    def advance(self, finished: int, failed: int) -> None:
        self.finished.append(finished)
        self.failed += failed


@dataclass(frozen=True)
class Home:
    """A folder with a small topology, in which campaigns are run."""

    folder: Path

    def sweep(self, out: str, trials: int = 4, *overrides: str, **more: Any) -> tuple[Path, Heard]:
        """Run a campaign in this process, with workers of its own."""
        heard = Heard()
        file = more.pop("file", self.folder / "small.yaml")
        request = Request(file, trials, overrides=overrides, out=self.folder / out, **more)
        return sweep(prepare(request), heard), heard

    def command(self, *arguments: str, timeout_s: float = PATIENCE_S) -> subprocess.CompletedProcess[str]:
        """Run the command in a process of its own."""
        return subprocess.run(
            [*COMMAND, *arguments],
            cwd=self.folder,
            env=environment(),
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def wait_until(holds: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < deadline, f"waited {PATIENCE_S} s in vain until {what}"
        time.sleep(0.02)


def same_bytes(one: Path, other: Path) -> bool:
    return (one / "results.parquet").read_bytes() == (other / "results.parquet").read_bytes()


def workers_of(directory: Path) -> list[int]:
    """The processes that hold a log of the campaign's workers open."""
    found = []
    for process in Path("/proc").iterdir():
        try:
            if process.name.isdigit() and str(directory) in os.readlink(process / "fd" / "1"):
                found.append(int(process.name))
        except OSError:
            continue
    return found


def table_of(directory: Path) -> pa.Table:
    return pq.read_table(directory / "results.parquet")


def facts_of(directory: Path) -> dict[str, Any]:
    facts: dict[str, Any] = json.loads((directory / "campaign.json").read_text())
    return facts


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Home:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(SMALL)
    (tmp_path / "moody.py").write_text(MOODY)
    return Home(tmp_path)
