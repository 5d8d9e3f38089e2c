"""Row f: how rate and processor time grow with the number of nodes, ours and bare Zenoh's."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

from benchmarks.comparison import Comparison
from benchmarks.contest import Contestant, Findings, interleave, ours, reference
from benchmarks.effort import Effort
from benchmarks.networks import BURSTS, geometric, network, write_shape

SIZES = (10, 20, 40, 80)
_NODE_STEPS = 6000
_SHAPE_STEPS = 20


def measure(rows: frozenset[str], effort: Effort) -> list[Comparison]:
    """Run all sizes in turn, and compare."""
    with tempfile.TemporaryDirectory() as folder:
        contestants = [each for nodes in SIZES for each in _pair(nodes, effort, Path(folder))]
        found = interleave(contestants, effort.repeats, effort.timeout_s, effort.tell)
    return [comparison for nodes in SIZES for comparison in _compare(nodes, *_pick(found, nodes))]


def _names(nodes: int) -> tuple[str, str]:
    return f"{nodes} nodes, processes", f"bare Zenoh, {nodes} nodes"


def _pair(nodes: int, effort: Effort, folder: Path) -> list[Contestant]:
    """Return ours and the bare network of one size; larger networks take fewer steps."""
    steps = effort.steps(_NODE_STEPS // nodes)
    topology, shape = folder / f"{nodes}.yaml", folder / f"{nodes}.json"
    topology.write_text(network(nodes, steps, geometric(nodes), channel=BURSTS))
    write_shape(topology, _SHAPE_STEPS, shape)
    name, bare = _names(nodes)
    command = reference("bare_zenoh.py", "--shape", shape, "--steps", steps)
    return [Contestant(name, ours(topology, "processes")), Contestant(bare, command)]


def _pick(found: Mapping[str, Findings], nodes: int) -> tuple[Findings, Findings]:
    name, bare = _names(nodes)
    return found[name], found[bare]


def _compare(nodes: int, own: Findings, bare: Findings) -> list[Comparison]:
    name, bare_name = _names(nodes)
    note = own.failure or bare.failure
    rate, cpu = "steps_per_s", "cpu_ms_per_step"
    per_node = [[each / nodes for each in findings.samples(cpu)] for findings in (own, bare)]
    return [
        Comparison(
            "f", f"{name}: rate", "steps/s", own.samples(rate), bare_name, bare.samples(rate), note=note
        ),
        Comparison("f", f"{name}: CPU", "ms/step/node", per_node[0], bare_name, per_node[1], note=note),
    ]
