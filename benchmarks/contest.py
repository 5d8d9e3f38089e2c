"""Contestants are programs that print one JSON line; they run in turn, each in processes of its own."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
REFERENCE = Path(__file__).parent / "reference"
_GRACE_S = 5.0
_INSTALL = "pip install -e '.[bench]'"


@dataclass(frozen=True)
class Contestant:
    """A program to be measured.

    ``OUT`` in the command stands for a fresh directory. ``needs`` are the modules without which it cannot
    run. ``check`` is given that directory after a run and says what is wrong with what was computed.
    """

    name: str
    command: tuple[str, ...]
    needs: tuple[str, ...] = ()
    check: Callable[[Path], str] = lambda out: ""

    def missing(self) -> str:
        """Return what to install before it can run, empty when it can."""
        absent = [module for module in self.needs if importlib.util.find_spec(module) is None]
        return f"{', '.join(absent)} missing: {_INSTALL}" if absent else ""


@dataclass
class Findings:
    """The figures of all runs of one contestant; ``failure`` is why it has none, or too few."""

    runs: list[dict[str, Any]] = field(default_factory=list)
    failure: str = ""

    def samples(self, figure: str) -> list[float]:
        """Return one figure of every run."""
        return [float(run[figure]) for run in self.runs]


OUT = "{out}"


def ours(topology: Path, backend: str, **settings: object) -> tuple[str, ...]:
    """Return the command that runs a topology of ours and measures it; its expectations are left out."""
    overrides = [f"{key}={value}" for key, value in {**settings, "expect": "null"}.items()]
    pairs = [argument for override in overrides for argument in ("--set", override)]
    return (sys.executable, "-m", "benchmarks.own", str(topology), "--backend", backend, "--out", OUT, *pairs)


def reference(script: str, *arguments: object) -> tuple[str, ...]:
    """Return the command that runs a reference."""
    return (sys.executable, str(REFERENCE / script), *map(str, arguments))


def run_once(contestant: Contestant, timeout_s: float) -> dict[str, Any]:
    """Run a contestant and return its figures; raises RuntimeError with the reason when there are none.

    It gets a session and a temporary directory of its own: neither processes nor files stay behind.
    """
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        out = Path(folder, "out")
        command = [str(out) if part == OUT else part for part in contestant.command]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": folder}
        process = subprocess.Popen(
            [*command, "--since", repr(time.monotonic())],
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            output, errors = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            raise RuntimeError(f"{contestant.name} did not end within {timeout_s:g} s") from None
        finally:
            _end_group(process)
        if process.returncode or not output.strip():
            reason = errors.strip().splitlines()[-1:] or [f"exit code {process.returncode}"]
            raise RuntimeError(f"{contestant.name} failed: {reason[0]}")
        figures: dict[str, Any] = json.loads(output.strip().splitlines()[-1])
        wrong = contestant.check(out) or ("" if figures.get("checked", True) else "wrong values")
        if wrong:
            raise RuntimeError(f"{contestant.name} computed {wrong}")
        return figures


def _end_group(process: subprocess.Popen[str]) -> None:
    """Kill what is left of a contestant's processes."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.communicate(timeout=_GRACE_S)


def interleave(
    contestants: Sequence[Contestant], repeats: int, timeout_s: float, tell: Callable[[str], None]
) -> Mapping[str, Findings]:
    """Run all contestants in turn, as often as asked; a contestant that failed is not run again."""
    found = {contestant.name: Findings(failure=contestant.missing()) for contestant in contestants}
    for repetition in range(repeats):
        for contestant in contestants:
            findings = found[contestant.name]
            if findings.failure:
                continue
            tell(f"{contestant.name}, {repetition + 1} of {repeats}")
            try:
                findings.runs.append(run_once(contestant, timeout_s))
            except RuntimeError as error:
                findings.failure = str(error)
    return found
