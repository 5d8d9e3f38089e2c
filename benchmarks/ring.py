"""Row e: a ring of 20 nodes with feedback each step, against HELICS and mosaik."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from benchmarks.comparison import Comparison, Wanted, at_least
from benchmarks.contest import Contestant, Findings, interleave, ours, reference
from benchmarks.effort import Effort
from benchmarks.reference.ring import agrees
from bus.messages import Estimate
from orchestrator.log.reader import read_log
from orchestrator.run_directory import LOG

TOPOLOGY = Path(__file__).parent / "topologies" / "ring.yaml"
NODES = 20
STEPS = 300

_PROCESSES, _ONE, _UNRECORDED = (
    "ring, processes",
    "ring, one process with log",
    "ring, one process without log",
)
_HELICS, _MOSAIK, _MOSAIK_ONE = "HELICS, zmq", "mosaik, processes", "mosaik, one process"

_ROWS: tuple[tuple[str, str, str, str, Wanted | None], ...] = (
    (_PROCESSES, _HELICS, "steps_per_s", "steps/s", at_least(2.0)),
    (_PROCESSES, _MOSAIK, "steps_per_s", "steps/s", at_least(1.3)),
    (_UNRECORDED, _MOSAIK_ONE, "steps_per_s", "steps/s", at_least(8.0)),
    (_ONE, _MOSAIK_ONE, "steps_per_s", "steps/s", None),
    (_PROCESSES, _HELICS, "start_up_s", "s", None),
    (_PROCESSES, _MOSAIK, "start_up_s", "s", None),
)
_WORDS = {"steps_per_s": "rate", "start_up_s": "start-up"}


def final_values(log: Path) -> list[float]:
    """Return the last value of every node of a recorded ring, in the order of the ring."""
    last = {topic: message for topic, message in read_log(log).records() if isinstance(message, Estimate)}
    return [last[f"estimate/e{number}"].state[0] for number in range(1, len(last) + 1)]


def _wrong(steps: int, out: Path) -> str:
    """Return what is wrong with a recorded ring's values, empty when nothing is."""
    return "" if agrees(final_values(out / LOG), steps) else "wrong values"


def contestants(steps: int) -> list[Contestant]:
    """Return all that run the ring."""

    def check(out: Path) -> str:
        return _wrong(steps, out)

    size = ("--nodes", NODES, "--steps", steps)
    mosaik = ("mosaik", "mosaik_api_v3")
    return [
        Contestant(_PROCESSES, ours(TOPOLOGY, "processes", steps=steps), check=check),
        Contestant(_HELICS, reference("helics_ring.py", *size), needs=("helics",)),
        Contestant(_MOSAIK, reference("mosaik_ring.py", "--mode", "processes", *size), needs=mosaik),
        Contestant(_ONE, ours(TOPOLOGY, "inprocess", steps=steps), check=check),
        Contestant(_UNRECORDED, ours(TOPOLOGY, "unrecorded", steps=steps)),
        Contestant(_MOSAIK_ONE, reference("mosaik_ring.py", "--mode", "inprocess", *size), needs=mosaik),
    ]


def measure(rows: frozenset[str], effort: Effort) -> list[Comparison]:
    """Run all rings in turn, and compare."""
    steps = effort.steps(STEPS)
    found = interleave(contestants(steps), effort.repeats, effort.timeout_s, effort.tell)
    return [_compare(found, *row) for row in _ROWS]


def _compare(
    found: Mapping[str, Findings], one: str, other: str, figure: str, unit: str, wanted: Wanted | None
) -> Comparison:
    return Comparison(
        "e",
        f"{one}: {_WORDS[figure]}",
        unit,
        found[one].samples(figure),
        other,
        found[other].samples(figure),
        wanted,
        found[one].failure or found[other].failure,
    )
