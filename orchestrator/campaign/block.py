"""A block: some trials of one variant, the piece of work that a worker is given and answers at once.

The answer is an Arrow stream: what crosses between processes and hosts, and what a shard holds.
"""

from __future__ import annotations

import functools
import gc
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isnan
from typing import TYPE_CHECKING

from bus.plan import Plan
from orchestrator.campaign.trial import TrialTiming, run_trial
from orchestrator.campaign.user_code import code_of
from orchestrator.evidence.rows import Row, failed_row
from orchestrator.evidence.table import schema, swept_columns, table
from orchestrator.topology.resolved import Topology

if TYPE_CHECKING:
    import pyarrow as pa

TIMING = "timing."
"""Before the names of columns that go into the table of timings, and not into the results."""
TIMING_COLUMNS = {
    f"{TIMING}wall_s": "float64",
    f"{TIMING}cpu_s": "float64",
    f"{TIMING}step_p50_s": "float64",
    f"{TIMING}step_p95_s": "float64",
    f"{TIMING}worker": "string",
}


@dataclass(frozen=True)
class Work:
    """What a block consists of.

    Parameters
    ----------
    variant
        The variant's number.
    trials
        Numbers of consecutive trials.
    settings
        The variant's values of what varies.
    packed
        Its plan and its topology, pickled.
    """

    variant: int
    trials: tuple[int, ...]
    settings: Mapping[str, str]
    packed: bytes


@functools.lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> tuple[Plan, Topology]:
    plan, logged = pickle.loads(packed)
    return plan, logged


def code_of_block(work: Work) -> Mapping[str, str]:
    """Return what is known here of the code of a user's own that a block runs, which is loaded."""
    return _code_of(work.packed)


@functools.lru_cache(maxsize=4)
def _code_of(packed: bytes) -> Mapping[str, str]:
    plan, _ = _unpacked(packed)
    return code_of([plan])


def shard_schema(groups: Sequence[str], swept: Sequence[str]) -> pa.Schema:
    """Return the schema of a block's answer: that of results, and the timings."""
    import pyarrow as pa

    types = {"float64": pa.float64(), "string": pa.string()}
    extended = schema(groups, swept)
    for name, kind in TIMING_COLUMNS.items():
        extended = extended.append(pa.field(name, types[kind]))
    return extended


def run_block(work: Work, worker: str) -> bytes:
    """Run the trials of a block; return their rows as an Arrow stream."""
    plan, logged = _unpacked(work.packed)
    rows: list[Row] = []
    gc.disable()  # a trial makes no circles worth looking for while it runs
    try:
        for trial in work.trials:
            found, timing = run_trial(plan, logged, trial)
            beside = _beside(work, timing, worker)
            for row in found:
                row.update(beside)
            rows += found
            gc.collect(0)
    finally:
        gc.enable()
    return _stream(rows, logged, work)


def failed_block(work: Work, message: str, worker: str) -> bytes:
    """Return the answer of a block whose trials came to nothing with their worker."""
    _, logged = _unpacked(work.packed)
    timing = TrialTiming(*[float("nan")] * 4)
    rows = [
        failed_row(logged.at(trial=trial).plan, message) | _beside(work, timing, worker)
        for trial in work.trials
    ]
    return _stream(rows, logged, work)


def _beside(work: Work, timing: TrialTiming, worker: str) -> Row:
    noted = {f"{TIMING}{name}": None if isnan(value) else value for name, value in asdict(timing).items()}
    swept = swept_columns(work.settings)
    return {"variant": work.variant, **swept, **noted, f"{TIMING}worker": worker}


def _stream(rows: Sequence[Row], logged: Topology, work: Work) -> bytes:
    import pyarrow as pa

    held = table(rows, shard_schema(sorted(logged.state_groups), list(work.settings)))
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, held.schema) as writer:
        writer.write_table(held)
    return bytes(sink.getvalue().to_pybytes())
