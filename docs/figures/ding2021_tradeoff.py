"""Draw what each remedy against lock-out costs, over the strength of the attack, and print it as a table.

Run it in the root of the repository: ``python docs/figures/ding2021_tradeoff.py --trials 30``. Every figure
comes from whole runs of ``topologies/ding2021/case_b.yaml`` and their scores. ``--steps-attacked`` makes the
attacks longer.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bus.messages import Message
from bus.plan import Plan
from orchestrator.backends.inprocess import run_messages
from orchestrator.score.results import Score
from orchestrator.score.scoring import score
from orchestrator.topology.load import load_topology

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HERE = Path(__file__).parent
CASE_B = HERE.parents[1] / "topologies" / "ding2021" / "case_b.yaml"
ATTACKED = ("e4", "e12")
FIRST = (90, 50)

REMEDIES: Mapping[str, tuple[str, ...]] = {
    "as published": (),
    "detector on the upper bound": ("estimators.e*.detector=upper_bound",),
    "neighbours, after 3": ("estimators.e*.readmission=neighbours", "estimators.e*.readmit_after=3"),
    "neighbours, after 6": ("estimators.e*.readmission=neighbours", "estimators.e*.readmit_after=6"),
}
STYLES = (("#c1121f", "o"), ("#8d99ae", "s"), ("#2a6f97", "^"), ("#e09f3e", "v"))


@dataclass(frozen=True)
class Outcome:
    """The shares of attacked samples let in and of runs locked out, and the position RMSE of `ATTACKED`."""

    let_in: float
    locked_out: float
    rmse: tuple[float, ...]


def scores(overrides: Sequence[str], trials: int) -> Iterator[Score]:
    """Run case B so many times and yield the scores."""
    topology = load_topology(CASE_B, [*overrides, "expect=null"])
    for trial in range(trials):
        plan = topology.at(trial=trial).plan
        yield score(plan, record(plan), state_groups=topology.state_groups, options=topology.score_options)


def record(plan: Plan) -> list[tuple[str, Message]]:
    """Run a plan in this process and return its messages."""
    messages: list[tuple[str, Message]] = []

    def keep(topic: str, message: Message) -> None:
        messages.append((topic, message))

    run_messages(plan, keep)
    return messages


def measure(strength: float, steps_attacked: int, remedy: Sequence[str], trials: int) -> Outcome:
    """Return what became of the trials of one attack and remedy."""
    attack = [f"attacks[{i}].bias.value={strength:g}" for i in range(len(FIRST))]
    attack += [f"attacks[{i}].steps=[{first},{first + steps_attacked - 1}]" for i, first in enumerate(FIRST)]
    attacked = rejected = locked_out = 0
    squares = [0.0] * len(ATTACKED)
    for result in scores([*attack, *remedy], trials):
        attacked += sum(window.packets for window in result.windows)
        rejected += sum(window.rejected for window in result.windows)
        locked_out += bool(result.lockouts)
        errors = {node.name: node.groups["position"].rmse for node in result.nodes}
        squares = [
            total + (errors[name] or math.inf) ** 2 for total, name in zip(squares, ATTACKED, strict=True)
        ]
    rmse = tuple(math.sqrt(total / trials) for total in squares)
    return Outcome(1.0 - rejected / attacked, locked_out / trials, rmse)


def print_table(outcomes: Mapping[str, Mapping[float, Outcome]]) -> None:
    """Print Markdown: let in / locked out; RMSE at the attacked nodes."""
    print("| strength |", " | ".join(outcomes), "|")
    print("|---|" + "---|" * len(outcomes))
    for strength in next(iter(outcomes.values())):
        cells = [
            f"{of[strength].let_in:.2f} / {of[strength].locked_out:.2f}; "
            + " ".join(f"{rmse:.2f}" for rmse in of[strength].rmse)
            for of in outcomes.values()
        ]
        print(f"| {strength:g} |", " | ".join(cells), "|")


def draw(
    outcomes: Mapping[str, Mapping[float, Outcome]], out: Path, trials: int, steps_attacked: int
) -> None:
    """Draw the three figures over the strength, a curve a remedy."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, 3))
    titles = ("attacked samples let in", "runs with a lock-out", "position RMSE of e4 and e12 (m)")
    for (label, of), (colour, marker) in zip(outcomes.items(), STYLES, strict=True):
        pooled = [math.sqrt(sum(rmse**2 for rmse in one.rmse) / len(one.rmse)) for one in of.values()]
        curves = ([one.let_in for one in of.values()], [one.locked_out for one in of.values()], pooled)
        for panel, curve in zip(panels, curves, strict=True):
            panel.plot(list(of), curve, color=colour, marker=marker, label=label, clip_on=False)
    for panel, title in zip(panels, titles, strict=True):
        panel.set_title(title, fontsize=10)
        panel.set_xlabel("bias added to the measurement")
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(alpha=0.3)
    for panel in panels[:2]:
        panel.set_ylim(0.0, 1.0)
        panel.yaxis.set_major_formatter(lambda share, _: f"{100.0 * share:.0f} %")
    panels[2].set_yscale("log")
    panels[2].set_yticks([0.3, 0.5, 1.0, 2.0, 5.0], ["0.3", "0.5", "1", "2", "5"])
    panels[2].minorticks_off()
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    figure.suptitle(f"{steps_attacked} attacked steps on s4 and on s12, {trials} runs a point", fontsize=10)
    with rc_context({"svg.hashsalt": "ding2021"}):
        figure.savefig(out, metadata={"Date": None} if out.suffix == ".svg" else None)


def main() -> None:
    """Measure, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=30)
    parser.add_argument("--steps-attacked", type=int, default=6)
    parser.add_argument("--strengths", type=float, nargs="+", default=[4.0, 6.0, 8.0, 12.0, 15.0, 20.0])
    parser.add_argument("--out", type=Path, default=HERE / "ding2021_tradeoff.svg")
    chosen = parser.parse_args()
    outcomes = {
        label: {
            strength: measure(strength, chosen.steps_attacked, remedy, chosen.trials)
            for strength in chosen.strengths
        }
        for label, remedy in REMEDIES.items()
    }
    print_table(outcomes)
    draw(outcomes, chosen.out, chosen.trials, chosen.steps_attacked)


if __name__ == "__main__":
    main()
