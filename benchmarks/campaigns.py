"""Row i: trials of a campaign a second of a worker's processor time, and the share of it that is mathematics.

The share is that of code in the folders ``nodes`` and ``channel`` and of what it calls; the rest is messages,
scheduling, score, rows and Arrow.
"""

from __future__ import annotations

import time
from pathlib import Path

from threadpoolctl import threadpool_limits

from benchmarks.comparison import Comparison, at_least
from benchmarks.effort import Effort
from benchmarks.sampling import sampled
from orchestrator.campaign.block import Work, run_block
from orchestrator.campaign.sweep import Request, prepare

_TOPOLOGIES = Path(__file__).parent.parent / "topologies"
CAMPAIGNS = {
    "Forti benchmark": (_TOPOLOGIES / "forti2019" / "injection.yaml", 2),
    "Ding case B": (_TOPOLOGIES / "ding2021" / "case_b.yaml", 10),
}
"""Topologies with the trials of a block."""
_MATHEMATICS = ("nodes", "channel")


def measure(rows: frozenset[str], effort: Effort) -> list[Comparison]:
    """Run blocks as a worker does, in this process."""
    comparisons = []
    for name, (file, trials) in CAMPAIGNS.items():
        rates, shares = [], []
        work = _work(file, max(1, round(trials * effort.scale)))
        with threadpool_limits(limits=1, user_api="blas"):
            run_block(work, "to load what it needs")
            for repetition in range(effort.repeats):
                effort.tell(f"trials of {name}, {repetition + 1} of {effort.repeats}")
                rate, share = _measured(work)
                rates.append(rate)
                shares.append(share)
        comparisons += [
            Comparison("i", f"{name}: trials of one worker", "trials/CPU s", rates),
            Comparison(
                "i",
                f"{name}: share of node and channel code",
                "of the time",
                shares,
                "all of a worker",
                [1.0] * effort.repeats,
                at_least(0.85),
            ),
        ]
    return comparisons


def _work(file: Path, trials: int) -> Work:
    (own,) = prepare(Request(file, trials)).variants
    return Work(0, tuple(range(trials)), own.variant.settings, own.packed)


def _measured(work: Work) -> tuple[float, float]:
    """Return the trials a second of processor time, and the share of samples in node and channel code."""
    begun_s = time.process_time()
    run_block(work, "1")
    rate = len(work.trials) / (time.process_time() - begun_s)
    with sampled() as counts:
        run_block(work, "1")
    return rate, sum(counts[folder] for folder in _MATHEMATICS) / max(sum(counts.values()), 1)
