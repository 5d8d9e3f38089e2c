"""One run of ours, measured as the references measure theirs; prints a JSON line as they do.

    python -m benchmarks.own topologies/ding2021/case_b.yaml --set steps=300 --set expect=null --out DIRECTORY

It does what `gauntlet run` does, after loading what that loads. Rate and processor time count from the first
whole step to the last, memory is read at the last one, and the start-up lasts from ``--since`` to the first.
``unrecorded`` is ``inprocess`` without a log: messages are made and thrown away.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

import orchestrator.command_line.app  # noqa: F401  what the command loads, and one BLAS thread before numpy
from benchmarks.reference.usage import cpu_s, memory_mb
from orchestrator.quick_start import load_to_run


def node_processes() -> list[int]:
    """Return the ids of this process and of its children's children: the nodes, without what forks them."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue
    own = os.getpid()
    return [own, *(pid for pid, parent in parents.items() if parents.get(parent) == own)]


class Meter:
    """Notes the first and the last whole step, and what the processes had used at each."""

    def __init__(self, steps: int) -> None:
        self._steps = steps
        self._pids: list[int] = []
        self._first = 0
        self._cpu_s = 0.0
        self.first_s = self._last_s = 0.0
        self._memory: dict[str, float] = {}

    def note(self, recorded: int) -> None:
        """Take the number of whole steps; a backend calls this whenever it has grown."""
        if not self._first:
            self._first, self.first_s = recorded, time.monotonic()
            self._pids = node_processes()
            self._cpu_s = cpu_s(self._pids)
        elif recorded == self._steps:
            self._last_s = time.monotonic()
            self._cpu_s = cpu_s(self._pids) - self._cpu_s
            self._memory = memory_mb(self._pids)

    def figures(self) -> dict[str, object]:
        """Return what was measured, ready for JSON."""
        steps = self._steps - self._first
        return {
            "processes": len(self._pids),
            "steps_per_s": round(steps / (self._last_s - self.first_s), 1),
            "cpu_ms_per_step": round(1e3 * self._cpu_s / steps, 2),
            **self._memory,
        }


def parse() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description="One run of Gauntlet, measured.")
    parser.add_argument("topology", type=Path)
    parser.add_argument("--backend", choices=["processes", "inprocess", "unrecorded"], default="processes")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--out", type=Path, required=True, help="directory of the run")
    parser.add_argument(
        "--since", type=float, help="monotonic time from which the start-up counts; default: now"
    )
    return parser.parse_args()


def main() -> None:
    """Run once and print the JSON line."""
    entered_s = time.monotonic()
    asked = parse()
    unrecorded = asked.backend == "unrecorded"
    topology, backend = load_to_run(
        asked.topology, asked.set, None, "inprocess" if unrecorded else asked.backend
    )
    plan = topology.plan
    meter = Meter(plan.steps)
    if unrecorded:
        from benchmarks.networks import run_counting

        run_counting(plan, meter.note)
    else:
        from orchestrator.run import run_topology
        from orchestrator.run_directory import make_run_directory

        directory = make_run_directory(asked.out, plan.name, plan.seed)
        report = run_topology(topology, directory, backend, meter.note)
        if report.exit_code:
            sys.exit(f"the run ended with code {report.exit_code}: {report.message}")
    start_up_s = meter.first_s - (entered_s if asked.since is None else asked.since)
    figures = {"nodes": len(plan.estimators), "steps": plan.steps, "start_up_s": round(start_up_s, 3)}
    sys.stdout.write(json.dumps({"backend": asked.backend, **figures, **meter.figures()}) + "\n")


if __name__ == "__main__":
    main()
