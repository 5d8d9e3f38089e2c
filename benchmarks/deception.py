"""What choosing gains costs a node of the filter under deception, in closed form and by programs."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from benchmarks.comparison import Comparison, at_most
from benchmarks.effort import Effort
from benchmarks.networks import cameras, load_text, ring
from bus.plan import Plan
from nodes.estimators.gain_lmi import Lmi
from nodes.estimators.gain_programs import Program

NODES, LARGE, SMALL = 8, 500, 20
BUDGET_US = 150.0
COMPLETE = f"{{complete: {{nodes: {NODES}}}}}"
_CLOSED_STEPS = 120
_NODE_STEPS = 10000
_PROGRAM_STEPS = {"nominal": 16, "moment": 2, "sector": 2}
_METHOD = "event_triggered_extended_kalman"
_UNIT = "µs/node step"

MethodUs = Callable[[Plan], float]


def measure(effort: Effort, method_us: MethodUs) -> list[Comparison]:
    """Time all designs in turn, in this process, by its processor time."""
    with tempfile.TemporaryDirectory() as folder:
        rows = _closed_form(effort, method_us, Path(folder))
        if find_spec("cvxpy") is None:
            return [*rows, Comparison("g", f"{_METHOD}, lmi", "ms/program", [], note="cvxpy is missing")]
        return rows + _programs(effort, method_us, Path(folder))


def _closed_form(effort: Effort, method_us: MethodUs, folder: Path) -> list[Comparison]:
    """Return the closed-form designs on eight nodes, and the first one on 20 and 500 with four neighbours."""
    steps = effort.steps(_CLOSED_STEPS)
    plans = {
        name: load_text(folder, cameras(NODES, steps, COMPLETE, f"{{riccati: {name}}}"))
        for name in ("nominal", "residual", "adversarial")
    }
    sizes = {
        nodes: load_text(
            folder,
            cameras(nodes, max(2, effort.steps(_NODE_STEPS) // nodes), ring(nodes), "{riccati: nominal}"),
        )
        for nodes in (LARGE, SMALL)
    }
    samples: dict[str | int, list[float]] = {name: [] for name in (*plans, *sizes)}
    for repetition in range(effort.repeats):
        effort.tell(f"gains in closed form, {repetition + 1} of {effort.repeats}")
        for name, plan in (plans | sizes).items():
            samples[name].append(method_us(plan))
    what = f"{_METHOD}, riccati"
    return [
        Comparison(
            "g",
            f"{what} nominal, {NODES} nodes, complete",
            _UNIT,
            samples["nominal"],
            "budget",
            [BUDGET_US],
            at_most(1.0),
        ),
        Comparison("g", f"{what} residual", _UNIT, samples["residual"]),
        Comparison("g", f"{what} adversarial", _UNIT, samples["adversarial"]),
        Comparison(
            "g",
            f"{what} nominal, {LARGE} nodes with 4 neighbours",
            _UNIT,
            samples[LARGE],
            f"{SMALL} nodes",
            samples[SMALL],
            at_most(1.3),
        ),
    ]


def _programs(effort: Effort, method_us: MethodUs, folder: Path) -> list[Comparison]:
    """Return what one program costs, and a node's whole step with it."""
    rows = []
    for variant, steps in _PROGRAM_STEPS.items():
        nodes = NODES if variant == "nominal" else 3
        graph = f"{{complete: {{nodes: {nodes}}}}}"
        plan = load_text(folder, cameras(nodes, steps, graph, f"{{lmi: {variant}}}"))
        whole, program, alone = list[float](), list[float](), list[float]()
        for repetition in range(effort.repeats):
            effort.tell(f"gains by programs, {variant}, {repetition + 1} of {effort.repeats}")
            method_us(plan)  # the compilation belongs to no step
            with _timed(Lmi, "solution") as asked, _timed(Program, "solve") as solved:
                whole.append(1e-3 * method_us(plan))
            calls = len(asked) // 2  # the run that is replayed, and the replay
            program.append(1e3 * sum(asked[calls:]) / calls)
            alone.append(1e3 * sum(solved[calls:]) / calls)
        what = f"{_METHOD}, lmi {variant}, {nodes} nodes"
        rows.append(Comparison("g", f"{what}: a program", "ms", program, "whole node step", whole))
        rows.append(Comparison("g", f"{what}: its solution in cvxpy", "ms", alone, "whole node step", whole))
    return rows


@contextmanager
def _timed(kind: Any, name: str) -> Iterator[list[float]]:
    """Note the processor time (s) of every call of a method."""
    taken: list[float] = []
    method = getattr(kind, name)

    def timed(*arguments: Any, **more: Any) -> Any:
        began_s = time.process_time()
        try:
            return method(*arguments, **more)
        finally:
            taken.append(time.process_time() - began_s)

    setattr(kind, name, timed)
    try:
        yield taken
    finally:
        setattr(kind, name, method)
