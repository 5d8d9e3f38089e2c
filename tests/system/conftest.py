"""Runs of the real command in real processes, each in a directory of its own, every wait bounded."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PLUGIN = Path(__file__).parent / "plugins" / "misbehaving.py"
PATIENCE_S = 90.0

SMALL = """
name: small
seed: 7
period_s: 0.1
steps: 40
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
graph: {ring: {nodes: 4}}
sensors:
  s1..s4: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}
estimators:
  e1..e4: {method: secure_distributed, coupling: 0.01}
channel:
  e*->e*: [{gilbert_elliott: {failure: 0.2, recovery: 0.5}}]
  s*->e*: [{bernoulli: {loss: 0.1}}]
attacks:
  - {bias: {value: 5.0}, on: s2->e2, steps: [10, 15]}
"""


def process_exists(pid: int) -> bool:
    """Whether a process runs; one that only waits to be reaped does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until(holds: Callable[[], Any], timeout_s: float, what: str) -> None:
    deadline = time.monotonic() + timeout_s
    while not holds():
        assert time.monotonic() < deadline, f"waited {timeout_s} s in vain until {what}"
        time.sleep(0.02)


@dataclass
class Launched:
    """A `gauntlet run` under way."""

    process: subprocess.Popen[str]
    out: Path
    output: tuple[str, str] = field(default=("", ""))

    def pids(self) -> dict[str, int]:
        """The process ids that the nodes wrote into their logs so far."""
        found = {}
        for log in (self.out / "nodes").glob("*.log"):
            first = re.match(r"(\S+): process (\d+)", log.read_text())
            if first:
                found[first[1]] = int(first[2])
        return found

    def wait_for_nodes(self, count: int) -> dict[str, int]:
        wait_until(lambda: len(self.pids()) == count, PATIENCE_S, f"{count} processes have started")
        return self.pids()

    def wait_for_log(self, size: int) -> None:
        log = self.out / "run.mcap"
        wait_until(lambda: log.exists() and log.stat().st_size > size, PATIENCE_S, "the log has grown")

    def finish(self) -> int:
        self.output = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode

    @property
    def errors(self) -> str:
        return self.output[1]

    def score(self) -> dict[str, Any]:
        return dict(json.loads((self.out / "score.json").read_text()))


class Gauntlet:
    """The command line in a directory of the test's own."""

    def __init__(self, home: Path) -> None:
        self.home = home
        self._launched: list[Launched] = []

    def write(self, text: str = SMALL, name: str = "topology.yaml") -> Path:
        path = self.home / name
        path.write_text(text)
        return path

    def call(self, *arguments: str | Path, timeout_s: float = PATIENCE_S) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            self.command(*arguments),
            cwd=self.home,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )

    def launch(self, topology: Path, *arguments: str | Path, out: str = "out") -> Launched:
        directory = self.home / out
        command = self.command("run", topology, "--out", directory, *arguments)
        process = subprocess.Popen(
            command,
            cwd=self.home,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        launched = Launched(process, directory)
        self._launched.append(launched)
        return launched

    def run(self, topology: Path, *arguments: str | Path, out: str = "out") -> Launched:
        launched = self.launch(topology, *arguments, out=out)
        launched.finish()
        return launched

    def log(self, topology: Path, *arguments: str | Path, out: str) -> bytes:
        """Run to the end and return the bytes of the log."""
        launched = self.run(topology, *arguments, out=out)
        assert launched.process.returncode in (0, 1), launched.errors
        return (launched.out / "run.mcap").read_bytes()

    def end(self) -> None:
        """Kill whatever is left, and insist that nothing was."""
        left = []
        for launched in self._launched:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(launched.process.pid, signal.SIGKILL)
            launched.process.wait(timeout=PATIENCE_S)
            for stream in (launched.process.stdout, launched.process.stderr):
                if stream is not None:
                    stream.close()
            left += [pid for pid in launched.pids().values() if process_exists(pid)]
        deadline = time.monotonic() + 5.0
        while left and time.monotonic() < deadline:
            left = [pid for pid in left if process_exists(pid)]
            time.sleep(0.05)
        assert not left, f"processes left behind: {left}"

    @staticmethod
    def command(*arguments: str | Path) -> list[str]:
        return [sys.executable, "-m", "orchestrator.command_line.app", *map(str, arguments)]


@pytest.fixture
def gauntlet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Gauntlet]:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    runner = Gauntlet(tmp_path)
    yield runner
    runner.end()


@pytest.fixture
def slow_topology(gauntlet: Gauntlet) -> Path:
    """The small network with one estimator that takes its time, so that there is time to interfere."""
    slow = f"  e1: {{method: '{PLUGIN}:Misbehaving', pause_s: 0.15}}\n  e2..e4: {{method: kalman}}\n"
    head, tail = SMALL.split("  e1..e4: {method: secure_distributed, coupling: 0.01}\n")
    return gauntlet.write(
        head + slow + tail.replace("  e*->e*: [{gilbert_elliott: {failure: 0.2, recovery: 0.5}}]\n", "")
    )
