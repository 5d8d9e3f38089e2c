"""How long a step takes: wall-clock facts, which stand beside results and never in them."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.sources import Source
from orchestrator.run_directory import TIMING

CAMPAIGN_TIMING = "timing.parquet"


@dataclass(frozen=True)
class StepTime:
    """Time of a step (s): its median and 95th percentile, each the median over ``trials``; NaN if unknown."""

    p50_s: float
    p95_s: float
    trials: int


def step_time(source: Source, variant: int | None = None) -> StepTime:
    """Return how long a step took in a run, or in the trials of a campaign or of one of its variants."""
    if source.kind == "run":
        file = source.path.with_name(TIMING)
        facts = json.loads(file.read_bytes()) if file.is_file() else {}
        p50, p95 = (facts.get(f"step_time_{name}_s") for name in ("p50", "p95"))
        return StepTime(_known(p50), _known(p95), int(p50 is not None))
    import pyarrow.parquet as pq

    file = source.path / CAMPAIGN_TIMING
    if not file.is_file():
        return StepTime(np.nan, np.nan, 0)
    held = pq.read_table(file, columns=["variant", "step_p50_s", "step_p95_s"]).to_pydict()
    chosen = np.array([variant is None or own == variant for own in held["variant"]], dtype=bool)
    p50, p95 = (np.array(held[f"step_{name}_s"], dtype=np.float64)[chosen] for name in ("p50", "p95"))
    kept = ~(np.isnan(p50) | np.isnan(p95))
    if not kept.any():
        return StepTime(np.nan, np.nan, 0)
    return StepTime(float(np.median(p50[kept])), float(np.median(p95[kept])), int(kept.sum()))


def _known(value: float | None) -> float:
    return np.nan if value is None else float(value)
