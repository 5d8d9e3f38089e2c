"""The command through its entry point: in this process where that tells the same, else in its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from orchestrator.command_line.app import main
from orchestrator.log.reader import read_log
from orchestrator.run import run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.topology.load import load_topology
from tests.playing import RING

ROOT = Path(__file__).parents[3]
PATIENCE_S = 60.0

SMALL = (
    RING.format(name="small", seed=7, steps=24)
    + """\
channel:
  e*->e*: {gilbert_elliott: {failure: 0.2, recovery: 0.5}}
attacks:
  - {bias: {value: 5.0}, on: s2->e2, steps: [10, 15]}
expect:
  divergences: 0
"""
)


@dataclass(frozen=True)
class Answer:
    """What a command left: its exit code, and what it printed."""

    code: int
    out: str
    err: str

    def json(self) -> Any:
        """Standard output, which must be one JSON document and nothing else."""
        return json.loads(self.out)


Command = Callable[..., Answer]


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A current directory that holds the small topology."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(SMALL)
    return tmp_path


@pytest.fixture
def gauntlet(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsysbinary: pytest.CaptureFixture[bytes]
) -> Command:
    """Run the entry point in this process."""
    monkeypatch.setenv("TERMINAL_WIDTH", "100")

    def call(*arguments: str | Path) -> Answer:
        monkeypatch.setattr(sys, "argv", ["gauntlet", *map(str, arguments)])
        code: Any = 0
        try:
            main()
        except SystemExit as left:
            code = left.code or 0
        printed = capsysbinary.readouterr()
        return Answer(code, printed.out.decode(), printed.err.decode())

    return call


@pytest.fixture
def gauntlet_process(home: Path) -> Callable[..., subprocess.Popen[str]]:
    """Begin the command in a process of its own."""

    def begin(*arguments: str | Path, **settings: Any) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "orchestrator.command_line.app", *map(str, arguments)],
            cwd=home,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            **settings,
        )

    return begin


@pytest.fixture
def cut_off(finished_run: Path, home: Path) -> tuple[Path, int]:
    """A log that breaks off amid the run, and how many of its 24 steps are whole."""
    whole = (finished_run / "run.mcap").read_bytes()
    log = home / "cut.mcap"
    log.write_bytes(whole[: len(whole) // 2])
    _, steps = read_log(log).counts()
    assert 0 < steps < 24
    return log, steps


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a run of the small topology, to be read only."""
    home = tmp_path_factory.mktemp("finished")
    (home / "small.yaml").write_text(SMALL)
    topology = load_topology(home / "small.yaml")
    directory = make_run_directory(home / "out", topology.plan.name, topology.plan.seed)
    report = run_topology(topology, directory, "inprocess", lambda recorded: None)
    assert report.exit_code == 0, report.message
    return directory
