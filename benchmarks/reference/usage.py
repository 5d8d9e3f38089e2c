"""What processes have used, read from Linux' /proc: processor time and memory."""

import os
import re
import statistics
from collections.abc import Sequence
from pathlib import Path


def cpu_s(pids: Sequence[int]) -> float:
    """Return the processor time that some processes have taken, in seconds."""
    ticks = 0
    for pid in pids:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def memory_mb(pids: Sequence[int]) -> dict[str, float]:
    """Return the median and total PSS and the median USS of some processes, in MiB."""
    pss, uss = [], []
    for pid in pids:
        fields = re.findall(
            r"^(\w+):\s+(\d+) kB", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.MULTILINE
        )
        sizes = {name: int(size) / 1024 for name, size in fields}
        pss.append(sizes["Pss"])
        uss.append(sizes["Private_Clean"] + sizes["Private_Dirty"])
    figures = {"pss_mb": statistics.median(pss), "uss_mb": statistics.median(uss), "total_pss_mb": sum(pss)}
    return {name: round(figure, 1) for name, figure in figures.items()}
