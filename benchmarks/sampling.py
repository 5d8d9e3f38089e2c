"""Whose code a process spends its time in: a sampler that looks at the stack every so often.

A sample counts for the innermost frame that is the project's own, by the folder that it lies in: time in
numpy counts for who called it. A statement that runs long in C is seen when it ends, and counts as it should.
"""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

_ROOT = f"{Path(__file__).parent.parent}/"
_FOLDERS = frozenset({"bus", "nodes", "channel", "orchestrator", "benchmarks", "tests"})
"""The project's own: libraries may lie in another folder of the same root."""
_EVERY_S = 0.001


@contextmanager
def sampled() -> Iterator[Counter[str]]:
    """Count samples of processor time by folder of the project while the context is open."""
    counts: Counter[str] = Counter()

    def sample(number: int, frame: FrameType | None) -> None:
        while frame is not None:
            file = frame.f_code.co_filename
            folder = file.removeprefix(_ROOT).partition("/")[0] if file.startswith(_ROOT) else ""
            if folder in _FOLDERS:
                counts[folder] += 1
                return
            frame = frame.f_back
        counts["other"] += 1

    before = signal.signal(signal.SIGPROF, sample)
    signal.setitimer(signal.ITIMER_PROF, _EVERY_S, _EVERY_S)
    try:
        yield counts
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
