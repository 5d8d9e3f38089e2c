"""What a process has used up."""

from __future__ import annotations

import resource
import sys

_UNIT_BYTES = 1 if sys.platform == "darwin" else 1024


def own_usage() -> tuple[float, int]:
    """Return the CPU time (s) and the peak memory (bytes) of this process so far."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss * _UNIT_BYTES
