"""What a backend is given and what it tells, besides the record."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from bus.usage import own_usage

Progress = Callable[[int], None]
"""Told the number of whole recorded steps, whenever it has grown."""


@dataclass(frozen=True)
class RunSettings:
    """How a run is carried out; nothing of it enters the log.

    ``window`` is the number of steps that the plant may lead what is recorded; ``stall_s`` how long nothing
    may be recorded before the run is given up. ``outlived`` are the nodes whose death ends no run of many
    processes: the others go on without them.
    """

    window: int = 32
    stall_s: float = 30.0
    outlived: frozenset[str] = frozenset()


class RunFailedError(RuntimeError):
    """The run could not go on; the message says who failed and how."""


@dataclass
class Timing:
    """Wall-clock facts of a run (s), beside the log and the score, never in them.

    Start-up lasts from the making of this object to the first recorded step.
    """

    startup_s: float = 0.0
    step_times_s: list[float] = field(default_factory=list)
    cpu_s: dict[str, float] = field(default_factory=dict)
    peak_memory_bytes: dict[str, int] = field(default_factory=dict)
    rejected: dict[str, Mapping[str, int]] = field(default_factory=dict)
    """By the process that refused them: the number of refused messages by topic."""
    _recorded: int = 0
    _noted_at: float = field(default_factory=time.monotonic)

    def note_steps(self, recorded: int) -> None:
        """Note that ``recorded`` steps are whole now; steps that became whole together share their time."""
        now = time.monotonic()
        since_s = now - self._noted_at
        if self._recorded == 0:
            self.startup_s = since_s
        else:
            steps = recorded - self._recorded
            self.step_times_s += [since_s / steps] * steps
        self._recorded, self._noted_at = recorded, now

    def note_own_usage(self, name: str) -> None:
        """Note the CPU time and peak memory of this process under a name."""
        self.cpu_s[name], self.peak_memory_bytes[name] = own_usage()

    @property
    def run_s(self) -> float:
        """Time from the first recorded step to the last."""
        return sum(self.step_times_s)

    def headlines(self) -> dict[str, float]:
        """Return what people ask for first: start-up time and, once there is one, the rate of steps."""
        rate = {"steps_per_s": len(self.step_times_s) / self.run_s} if self.step_times_s else {}
        return {"startup_s": self.startup_s, **rate}

    def facts(self, backend: str) -> dict[str, object]:
        """Return all figures, ready for JSON; percentiles are of the time between recorded steps."""
        p50, p95 = (
            np.percentile(self.step_times_s, [50.0, 95.0]).tolist() if self.step_times_s else (None, None)
        )
        return {
            "backend": backend,
            **self.headlines(),
            "run_s": self.run_s,
            "step_time_p50_s": p50,
            "step_time_p95_s": p95,
            "cpu_s": self.cpu_s,
            "peak_memory_bytes": self.peak_memory_bytes,
            "rejected_messages": self.rejected,
        }
