"""From shards to the results file: the same bytes whoever ran which trial when.

Rows are sorted by variant and trial, and within a trial stand in the order of the topology. Row groups end at
a trial, at the first that brings a group to `GROUP_ROWS`: a function of the rows alone.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator.campaign.block import TIMING, TIMING_COLUMNS
from orchestrator.campaign.directory import TIMING as TIMING_FILE
from orchestrator.campaign.directory import CampaignError, Shard, in_one_stroke
from orchestrator.campaign.failures import is_lost
from orchestrator.evidence.sources import RESULTS

if TYPE_CHECKING:
    import pyarrow as pa

GROUP_ROWS = 512
_COMPRESSION = "zstd"
_KEYS = ("variant", "trial")
Trial = tuple[int, int]
"""A trial's variant and number."""


def finished_trials(directory: Path, shards: Iterable[Shard]) -> set[Trial]:
    """Return the trials that need not be run: those of the results file, and those of the shards.

    Trials that were lost with their workers are not among them.
    """
    in_shards: set[Trial] = set()
    for shard in shards:
        # a lost trial has been tried alone
        if shard.first < shard.last or not is_lost(_message_of(shard)):
            in_shards |= {(shard.variant, trial) for trial in range(shard.first, shard.last + 1)}
    return in_shards | _trials_in_results(directory / RESULTS)


def _message_of(shard: Shard) -> str | None:
    import pyarrow as pa

    with pa.ipc.open_stream(shard.path.read_bytes()) as reader:
        message: str | None = reader.read_all()["message"][0].as_py()
    return message


def _trials_in_results(results: Path) -> set[Trial]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not results.exists():
        return set()
    try:
        held = pq.read_table(results, columns=[*_KEYS, "message"])
    except (pa.ArrowException, OSError) as error:
        raise CampaignError(
            f"{results} is damaged; remove it, so that its trials are run again, or choose another --out"
        ) from error
    rows = zip(*(held[name].to_pylist() for name in (*_KEYS, "message")), strict=True)
    return {(variant, trial) for variant, trial, message in rows if not is_lost(message)}


def write_results(directory: Path, shards: Sequence[Shard], schema: pa.Schema, trials: range) -> None:
    """Write results and timings anew, from what was there before and the shards; each file in one stroke.

    ``schema`` is that of all variants' results; of the shards, only ``trials`` are taken. A trial that stands
    in both is taken from the shards: it is the same, or was lost before.
    """
    import pyarrow as pa

    timing = pa.schema(
        [schema.field(name) for name in _KEYS]
        + [
            pa.field(name.removeprefix(TIMING), pa.float64() if kind == "float64" else pa.string())
            for name, kind in TIMING_COLUMNS.items()
        ]
    )
    parts = (
        # the timings first: where there are results, there is all
        (directory / TIMING_FILE, timing, _timing_of),
        (directory / RESULTS, schema, _fitted),
    )
    for path, own, made in parts:
        fresh = ((key, made(found, own)) for key, found in _of_shards(shards) if key[1] in trials)
        _write(path, own, _merged(fresh, _of_file(path, own)))


def _merged(
    fresh: Iterator[tuple[Trial, pa.Table]], old: Iterator[tuple[Trial, pa.Table]]
) -> Iterator[pa.Table]:
    """Return the tables of all trials, sorted; of two of one trial the fresh one."""
    last: Trial | None = None
    for key, own in heapq.merge(fresh, old, key=lambda pair: pair[0]):
        if key != last:
            yield own
        last = key


def _of_shards(shards: Sequence[Shard]) -> Iterator[tuple[Trial, pa.Table]]:
    import pyarrow as pa

    for shard in sorted(shards):
        with pa.ipc.open_stream(shard.path.read_bytes()) as reader:
            yield from _by_trial(reader.read_all())


def _of_file(path: Path, schema: pa.Schema) -> Iterator[tuple[Trial, pa.Table]]:
    import pyarrow.parquet as pq

    if not path.exists():
        return
    with pq.ParquetFile(path) as file:
        for group in range(file.num_row_groups):
            yield from _by_trial(_fitted(file.read_row_group(group), schema))


def _by_trial(held: pa.Table) -> Iterator[tuple[Trial, pa.Table]]:
    """Return a sorted table trial by trial."""
    keys = list(zip(*(held[name].to_pylist() for name in _KEYS), strict=True))
    begin = 0
    for end in range(1, len(keys) + 1):
        if end == len(keys) or keys[end] != keys[begin]:
            yield keys[begin], held.slice(begin, end - begin)
            begin = end


def _fitted(held: pa.Table, schema: pa.Schema) -> pa.Table:
    """Return a table with exactly the columns of a schema; one that it lacks is null."""
    import pyarrow as pa

    columns = [
        held[field.name] if field.name in held.column_names else pa.nulls(held.num_rows, field.type)
        for field in schema
    ]
    return pa.Table.from_arrays(columns, schema=schema)


def _timing_of(held: pa.Table, timing: pa.Schema) -> pa.Table:
    """Return the timings of one trial, whose rows all carry the same."""
    first = held.slice(0, 1)
    return first.select([*_KEYS, *TIMING_COLUMNS]).rename_columns(timing.names).cast(timing)


def _write(path: Path, schema: pa.Schema, tables: Iterable[pa.Table]) -> None:
    import pyarrow.parquet as pq

    with (
        in_one_stroke(path) as beside,
        pq.ParquetWriter(beside, schema, compression=_COMPRESSION, version="2.6") as writer,
    ):
        for group in _grouped(tables):
            writer.write_table(group, row_group_size=group.num_rows)


def _grouped(tables: Iterable[pa.Table]) -> Iterator[pa.Table]:
    import pyarrow as pa

    held: list[pa.Table] = []
    rows = 0
    for own in tables:
        held.append(own)
        rows += own.num_rows
        if rows >= GROUP_ROWS:
            yield pa.concat_tables(held).combine_chunks()
            held, rows = [], 0
    if held:
        yield pa.concat_tables(held).combine_chunks()
