"""Print errors, consistency and agreement of the distributed filters side by side, as Markdown.

Run it in the root of the repository: ``python docs/figures/distributed_comparison.py --trials 20``. Every
figure comes from whole runs of ``topologies/distributed`` and their scores.
"""

from __future__ import annotations

import argparse
import math
import re
from pathlib import Path

import numpy as np

from bus.messages import Message
from orchestrator.backends.inprocess import run_messages
from orchestrator.score.scoring import score
from orchestrator.topology.load import load_topology

TOPOLOGIES = Path(__file__).parents[2] / "topologies" / "distributed"


def measure(stem: str, trials: int) -> dict[str, tuple[float, float, float]]:
    """Return by family the position RMSE, NEES by its dof, and disagreement, over all trials."""
    topology = load_topology(TOPOLOGIES / f"{stem}.yaml", ["expect=null"])
    found: dict[str, list[tuple[float, float]]] = {}
    apart: dict[str, list[float]] = {}
    for trial in range(trials):
        plan = topology.at(trial=trial).plan
        record: list[tuple[str, Message]] = []
        run_messages(plan, lambda topic, message: record.append((topic, message)))  # noqa: B023
        result = score(plan, record, state_groups=topology.state_groups, options=topology.score_options)
        for node in result.nodes:
            figures = node.groups["position"].rmse or math.inf, (node.nees.mean or math.nan) / 4.0
            found.setdefault(re.sub(r"\d+$", "", node.name), []).append(figures)
        for network in result.networks:
            family = re.sub(r"\d+$", "", network.members[0])
            apart.setdefault(family, []).append(network.disagreement or 0.0)
    return {
        family: (
            float(np.sqrt(np.mean(np.square(rows), axis=0))[0]),
            float(np.mean(rows, axis=0)[1]),
            float(np.sqrt(np.mean(np.square(apart.get(family, [0.0]))))),
        )
        for family, rows in found.items()
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=20)
    trials = parser.parse_args().trials
    for stem in ("comparison", "comparison_loss"):
        print(f"\n| {stem} | position RMSE | NEES | disagreement |\n|---|---|---|---|")
        for family, (rmse, nees, apart) in measure(stem, trials).items():
            print(f"| {family} | {rmse:.3f} | {nees:.2f} | {apart:.3f} |", flush=True)


if __name__ == "__main__":
    main()
