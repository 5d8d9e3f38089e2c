"""Print how often each event trigger sends, and what error it leaves, over its parameter, as Markdown.

Run it in the root of the repository: ``python docs/figures/trigger_sweep.py --trials 20``. Every figure comes
from whole runs of ``topologies/triggers`` and their scores. Each trigger is met by a filter that learns from
its silence and by one that does not.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bus.messages import Message
from orchestrator.backends.inprocess import run_messages
from orchestrator.score.scoring import score
from orchestrator.topology.load import load_topology

TOPOLOGIES = Path(__file__).parents[2] / "topologies" / "triggers"

SWEEP: Mapping[str, tuple[str, Sequence[float]]] = {
    "periodic": ("periodic.every", (1, 2, 3, 5, 8)),
    "send_on_delta": ("send_on_delta.threshold", (0.25, 0.5, 0.75, 1.0, 1.5)),
    "relative": ("relative.sigma", (0.02, 0.1, 0.2, 0.5, 1.0)),
    "deterministic_innovation": ("deterministic_innovation.threshold", (0.5, 0.95, 1.3, 1.7, 2.2)),
    "stochastic_innovation": ("stochastic_innovation.Y", (40.0, 15.0, 7.0, 3.0, 1.0)),
    "stochastic_innovation_open": ("stochastic_innovation.Y", (40.0, 10.0, 3.0, 1.0, 0.3)),
}


@dataclass(frozen=True)
class Point:
    """The share of slots used, and over all trials and nodes the position RMSE and the NEES by its dof."""

    rate: float
    rmse: float
    nees: float


def measure(stem: str, overrides: Sequence[str], trials: int) -> Point:
    """Return the figures of one topology over its trials."""
    topology = load_topology(TOPOLOGIES / f"{stem}.yaml", [*overrides, "expect=null"])
    slots, sent, squares, nees = 0, 0.0, [], []
    for trial in range(trials):
        plan = topology.at(trial=trial).plan
        record: list[tuple[str, Message]] = []
        run_messages(plan, lambda topic, message: record.append((topic, message)))  # noqa: B023
        result = score(plan, record, state_groups=topology.state_groups, options=topology.score_options)
        slots += sum(sender.slots for sender in result.senders)
        sent += sum(sender.sent for sender in result.senders)
        squares += [(node.groups["position"].rmse or math.inf) ** 2 for node in result.nodes]
        nees += [(node.nees.mean or math.nan) / (node.nees.dof or math.nan) for node in result.nodes]
    return Point(sent / slots, math.sqrt(sum(squares) / len(squares)), sum(nees) / len(nees))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=20)
    trials = parser.parse_args().trials
    print("| topology | parameter | rate | RMSE, NEES | RMSE, NEES when silence is ignored |")
    print("|---|---|---|---|---|")
    for stem, (parameter, values) in SWEEP.items():
        for value in values:
            stated = f"sensors.s*.send.{parameter}={value:g}"
            heard = measure(stem, [stated], trials)
            deaf = measure(stem, [stated, "estimators.e*.silence=ignored"], trials)
            name = f"`{parameter.rpartition('.')[2]}` {value:g}"
            figures = (
                f"{heard.rate:.3f} | {heard.rmse:.3f}, {heard.nees:.2f} | {deaf.rmse:.3f}, {deaf.nees:.2f}"
            )
            print(f"| `{stem}` | {name} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
