"""What the benchmark of the gains runs, and that its watch leaves nothing behind."""

from __future__ import annotations

from pathlib import Path

from benchmarks.deception import _timed
from benchmarks.networks import cameras, load_text, ring, run_counting
from nodes.estimators.gain_riccati import Riccati


def test_a_large_network_of_cameras_has_nodes_of_four_neighbours_and_their_gains_are_timed(
    tmp_path: Path,
) -> None:
    plan = load_text(tmp_path, cameras(30, 3, ring(30), "{riccati: nominal}"))
    assert {len(own.neighbours) for own in plan.estimators} == {4}
    original, counted = Riccati.gains, list[int]()
    with _timed(Riccati, "gains") as taken:
        run_counting(plan, counted.append)
    assert counted[-1] == 3
    assert len(taken) == 90
    assert min(taken) >= 0.0
    assert Riccati.gains is original
