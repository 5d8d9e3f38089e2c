"""Rows a to d: the network of Ding 2021 in processes, against bare Zenoh and against one process."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

from benchmarks.comparison import Comparison, Wanted, at_least, at_most
from benchmarks.contest import ROOT, Contestant, Findings, interleave, ours, reference
from benchmarks.effort import Effort
from benchmarks.networks import write_shape

TOPOLOGY = ROOT / "topologies" / "ding2021" / "case_b.yaml"
STEPS = 600
_SHAPE_STEPS = 50

_OURS, _BARE, _ONE = "Ding network, processes", "bare Zenoh", "Ding network, one process"

_AGAINST_BARE: tuple[tuple[str, str, str, str, Wanted | None], ...] = (
    ("a", "rate", "steps_per_s", "steps/s", at_least(0.7)),
    ("a", "CPU of all processes", "cpu_ms_per_step", "ms/step", None),
    ("b", "start-up to the first whole step", "start_up_s", "s", at_most(1.5)),
    ("d", "memory a process, PSS", "pss_mb", "MiB", None),
    ("d", "memory a process, USS", "uss_mb", "MiB", None),
    ("d", "memory of all processes, PSS", "total_pss_mb", "MiB", None),
)
_IN_ONE: tuple[tuple[str, str, str, str, Wanted | None], ...] = (
    ("c", "rate in one process, with log", "steps_per_s", "steps/s", at_least(3.0)),
    ("c", "CPU in one process, with log", "cpu_ms_per_step", "ms/step", None),
)


def measure(rows: frozenset[str], effort: Effort) -> list[Comparison]:
    """Run what the rows need, in turn, and compare."""
    with tempfile.TemporaryDirectory() as folder:
        shape = Path(folder, "shape.json")
        write_shape(TOPOLOGY, _SHAPE_STEPS, shape)
        steps = effort.steps(STEPS)
        contestants = [Contestant(_OURS, ours(TOPOLOGY, "processes", steps=steps))]
        if rows & set("abd"):
            command = reference("bare_zenoh.py", "--shape", shape, "--steps", steps)
            contestants.append(Contestant(_BARE, command))
        if "c" in rows:
            contestants.append(Contestant(_ONE, ours(TOPOLOGY, "inprocess", steps=steps)))
        found = interleave(contestants, effort.repeats, effort.timeout_s, effort.tell)
    against_bare = [_compare(found, _OURS, _BARE, *row) for row in _AGAINST_BARE if row[0] in rows]
    in_one = [_compare(found, _ONE, _OURS, *row) for row in _IN_ONE if row[0] in rows]
    return sorted(against_bare + in_one, key=lambda comparison: comparison.row)


def _compare(
    found: Mapping[str, Findings],
    one: str,
    other: str,
    row: str,
    what: str,
    figure: str,
    unit: str,
    wanted: Wanted | None,
) -> Comparison:
    return Comparison(
        row,
        f"{one if one == _OURS else 'Ding network'}: {what}",
        unit,
        found[one].samples(figure),
        other,
        found[other].samples(figure),
        wanted,
        found[one].failure or found[other].failure,
    )
