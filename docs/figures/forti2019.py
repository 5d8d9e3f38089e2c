"""Draw the figures of Forti et al. 2019 from whole runs of ``topologies/forti2019``, three pictures in all.

Run it in the root of the repository: ``python docs/figures/forti2019.py --trials 100``. Single-run panels
show trial 0; errors are root mean squares over the trials.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bus.messages import ChannelEvents, Estimate, Message, Truth
from orchestrator.backends.inprocess import run_messages
from orchestrator.topology.load import load_topology

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

HERE = Path(__file__).parent
FOLDER = HERE.parents[1] / "topologies" / "forti2019"
LINK = "s1->e1"
BELIEVED = (1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.5, 0.9)
TRUTH, ESTIMATE, THIRD = "#1d3557", "#c1121f", "#2a6f97"
SWEEPS = {
    "ieee14_sweep": (("state", "signal"), slice(2, None)),
    "ieee14_sweep_near": (("state",), slice(2, None)),
    "sweep_near": (("state",), slice(40, 150)),
}
"""Whose errors are drawn, and the steps that count: past the prior, for the benchmark before the attack."""


@dataclass(frozen=True)
class Run:
    """A trial: truth and, by estimator, what it says; ``fakes`` and ``lost`` (K,) count packets of `LINK`."""

    state: Floats
    attack: Floats
    said: dict[str, Floats]
    """By estimator (K, n + 1 + q): the state, the attack probability, the signal."""
    fakes: Floats
    lost: Floats

    def error(self, node: str = "e1") -> Floats:
        """Return the errors (K, n) of the state."""
        return np.asarray(self.said[node][:, : self.state.shape[1]] - self.state)

    def probability(self, node: str = "e1") -> Floats:
        """Return ``r`` (K,)."""
        return self.said[node][:, self.state.shape[1]]

    def signal(self, node: str = "e1") -> Floats:
        """Return the estimate (K, q) of the signal."""
        return self.said[node][:, self.state.shape[1] + 1 :]


def carry_out(name: str, trial: int, overrides: Sequence[str] = ()) -> Run:
    """Run one trial of a topology file in this process."""
    topology = load_topology(FOLDER / f"{name}.yaml", [*overrides, "expect=null"]).at(trial=trial)
    truth: list[Truth] = []
    said: dict[str, list[list[float]]] = {}
    counts = np.zeros((2, topology.plan.steps))

    def keep(topic: str, message: Message) -> None:
        if isinstance(message, Truth):
            truth.append(message)
        elif isinstance(message, Estimate):
            named = dict(zip(message.diagnostic_name, message.diagnostic_value, strict=True))
            heard = [named["attack_probability"], named["a0"], named["a1"]]
            said.setdefault(topic.partition("/")[2], []).append([*message.state, *heard])
        elif isinstance(message, ChannelEvents) and LINK in message.link:
            place = message.link.index(LINK)
            for row, column in zip(counts, (message.injected, message.lost), strict=True):
                row[message.step] += column[place] if column else 0

    run_messages(topology.plan, keep)
    return Run(
        np.array([one.state for one in truth]),
        np.array([one.attack for one in truth]),
        {node: np.array(rows) for node, rows in said.items()},
        *counts,
    )


def rms_by_step(errors: Sequence[Floats]) -> Floats:
    """Return the root mean square (K,) over runs and components."""
    return np.asarray(np.sqrt(np.mean(np.square(errors), axis=(0, 2))))


def _follow(panel: Axes, title: str, truth: Floats, *estimates: Floats) -> None:
    panel.plot(truth, color=TRUTH, lw=1.6, label="true")
    for estimate in estimates:
        panel.plot(estimate, color=ESTIMATE, lw=0.9, label="estimated")
    panel.set_title(title, fontsize=9)


def draw_benchmark(figure: Figure) -> None:
    """Draw Figs 3 to 5 from one run under injection."""
    run = carry_out("injection", 0, [f"estimators.e{i}=null" for i in range(2, 7)])
    on = run.attack.any(axis=1)
    panels: list[Axes] = list(figure.subplots(5, 1, sharex=True))
    _follow(panels[0], "Fig 3: probability of an attack", on.astype(float), run.probability())
    for i in (0, 1):
        _follow(panels[1 + i], f"Fig 4: x{i + 1}", run.state[:, i], run.said["e1"][:, i])
        signal = np.where(on, run.signal()[:, i], np.nan)
        _follow(panels[3 + i], f"Fig 5: a{i + 1}, while there is an attack", run.attack[:, i], signal)
    panels[0].legend(frameon=False, fontsize=8, loc="center left")
    panels[-1].set_xlabel("step")


def _over_trials(panels: Sequence[Axes], label: str, runs: Sequence[Run]) -> None:
    """Draw the four panels of Figs 8 and 11."""
    during: NDArray[np.bool_] = np.asarray(runs[0].attack.any(axis=1, keepdims=True))
    mean = np.asarray(np.mean([run.probability() for run in runs], axis=0))
    _follow(panels[0], f"{label}a: probability", during[:, 0].astype(float), mean)
    errors = (
        ("b: signal (p.u.)", [np.where(during, r.signal() - r.attack, np.nan) for r in runs]),
        ("c: angles (rad)", [run.error()[:, :5] for run in runs]),
        ("d: frequencies (rad/s)", [run.error()[:, 5:] for run in runs]),
    )
    for panel, (title, of_runs) in zip(panels[1:], errors, strict=True):
        panel.plot(rms_by_step(of_runs), color=THIRD, lw=1.2)
        panel.set_title(f"{label}{title}, RMSE", fontsize=9)
        panel.set_ylim(0.0, None)


def draw_network(figure: Figure, trials: int) -> None:
    """Draw Figs 7 to 10 from runs of the power network under injection."""
    runs = [carry_out("ieee14_injection", trial) for trial in range(trials)]
    panels: list[Axes] = list(figure.subplots(2, 4).flat)
    first, step = runs[0], np.arange(len(runs[0].lost))
    panels[0].plot(step, first.fakes, ".", color=THIRD)
    panels[0].plot(step[first.lost > 0], -np.ones(int((first.lost > 0).sum())), "x", color=ESTIMATE)
    panels[0].set_title("Fig 7: fakes a step; lost (x)", fontsize=9)
    _over_trials(panels[1:5], "Fig 8", runs)
    for panel, title, pair in (
        (panels[5], "Fig 9: angles 1 and 3", (0, 2)),
        (panels[6], "Fig 10: frequencies 1 and 3", (5, 7)),
    ):
        for i in pair:
            _follow(panel, title, first.state[:, i], first.said["e1"][:, i])
    panels[7].set_axis_off()


def error_by_belief(runs: Sequence[Run], what: str, steps: slice) -> Floats:
    """Return the error of ``state`` or ``signal`` over runs, steps and components for each ``p_f``."""
    nodes = [f"e{i + 1}" for i in range(len(BELIEVED))]
    if what == "state":
        errors = [[run.error(node)[steps] for run in runs] for node in nodes]
    else:
        on = runs[0].attack.any(axis=1)
        errors = [[(run.signal(node) - run.attack)[on] for run in runs] for node in nodes]
    return np.asarray(np.sqrt([np.mean(np.square(of_node)) for of_node in errors]))


def draw_substitution(figure: Figure, trials: int, sweep_trials: int) -> None:
    """Draw Figs 11 and 12, the latter with wide fakes and with near ones."""
    panels: list[Axes] = list(figure.subplots(2, 4).flat)
    _over_trials(panels[:4], "Fig 11", [carry_out("ieee14_substitution", trial) for trial in range(trials)])
    places = iter(panels[4:])
    for name, (wanted, steps) in SWEEPS.items():
        runs = [carry_out(name, trial) for trial in range(trials if "ieee14" in name else sweep_trials)]
        for what in wanted:
            error = error_by_belief(runs, what, steps)
            print(f"{name}: {what}", error.round(4))
            panel = next(places)
            panel.semilogx(BELIEVED, error, "o-", color=THIRD)
            panel.axvline(0.1, color=TRUTH, lw=0.8, ls=":")
            panel.set_title(f"Fig 12: {what}, {name}", fontsize=9)
            panel.set_xlabel("believed $p_f$")
            panel.set_ylim(0.97 * error.min(), 1.15 * error.min())


def save(figure: Figure, name: str) -> None:
    """Write a picture; equal runs give equal bytes."""
    from matplotlib import rc_context

    for panel in figure.axes:
        panel.spines[["top", "right"]].set_visible(False)
    with rc_context({"svg.hashsalt": "forti2019"}):
        figure.savefig(HERE / f"forti2019_{name}.svg", metadata={"Date": None})


def main() -> None:
    """Run, draw and write."""
    from matplotlib.figure import Figure

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--sweep-trials", type=int, default=20, help="of the benchmark under near fakes")
    chosen = parser.parse_args()
    size: dict[str, Any] = {"layout": "constrained"}
    one, two, three = (Figure(figsize=shape, **size) for shape in ((7.0, 8.0), (12.0, 5.0), (12.0, 5.0)))
    draw_benchmark(one)
    save(one, "benchmark")
    draw_network(two, chosen.trials)
    save(two, "network")
    draw_substitution(three, chosen.trials, chosen.sweep_trials)
    save(three, "substitution")


if __name__ == "__main__":
    main()
