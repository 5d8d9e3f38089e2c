"""The networks that are measured: topologies of any size, and their shape as the bare network needs it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from bus.messages import Message, encode
from bus.plan import Plan
from orchestrator.backends.inprocess import run_messages
from orchestrator.topology.load import load_topology

SECURE = "{method: secure_distributed, coupling: 0.004, threshold: 25}"
BURSTS = "{e*->e*: {gilbert_elliott: {failure: 0.1, recovery: 0.92, scope: shared}}}"

_KINDS = {
    "truth": "truth",
    "tx/measurement": "slot",
    "rx/correct": "correct",
    "tx/exchange": "exchange_slot",
    "rx/exchange": "exchange",
    "estimate": "estimate",
    "channel/correct": "event",
    "channel/exchange": "event",
}
"""What the bare network calls the messages of ours."""


def geometric(nodes: int) -> str:
    """Return a random geometric graph: that of the Ding network at 20 nodes, as dense at other numbers."""
    radius = 0.35 * (20 / nodes) ** 0.5
    return f"{{random_geometric: {{nodes: {nodes}, radius: {radius:.4f}, seed: 10}}}}"


def ring(nodes: int) -> str:
    """Return a ring with four neighbours a node."""
    return f"{{ring: {{nodes: {nodes}, neighbours: 4}}}}"


def network(
    nodes: int, steps: int, graph: str, *, estimator: str = SECURE, channel: str = "{}", attacks: str = "[]"
) -> str:
    """Return a topology like that of Ding 2021: as many sensors as estimators, each paired with one."""
    return f"""\
name: benchmark
period_s: 0.05
steps: {steps}
plant: {{model: constant_acceleration, process_noise: {{std: 0.2}}, initial: {{std: 1.4}}}}
sensors:
  s1..s{nodes}: {{model: linear, C: [[4.5, -0.8, -0.5]], noise: {{std: 0.05}}}}
estimators:
  e1..e{nodes}: {estimator}
graph: {graph}
channel: {channel}
attacks: {attacks}
"""


def tanks(steps: int, estimator: str) -> str:
    """Return the tanks of Sadeghzadeh-Nokhodberiz 2022 with one estimator behind an attacked link."""
    return f"""\
name: benchmark
period_s: 1.0
steps: {steps}
plant: {{model: quadruple_tank}}
sensors:
  s1: {{model: linear, C: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], noise: {{std: 0.0316}}}}
estimators:
  e1: {estimator}
attacks:
  - {{converging_bias: {{target: 0.5}}, on: s1->e1}}
"""


def cameras(nodes: int, steps: int, graph: str, design: str) -> str:
    """Return the cameras of Zhou 2020 at level 5, on a grid that begins anew after twelve of them."""
    sensors = "\n".join(
        f"  s{i + 1}: {{model: ceiling_camera, noise: {{std: 1.0}}, "
        f"position: [{0.6 + 0.6 * (i % 4):.1f}, {0.6 + 0.6 * (i // 4 % 3):.1f}]}}"
        for i in range(nodes)
    )
    return f"""\
name: benchmark
period_s: 1.0
steps: {steps}
plant: {{model: planar_robot}}
sensors:
{sensors}
estimators:
  e1..e{nodes}:
    method: event_triggered_extended_kalman
    send: {{relative: {{sigma: 0.02}}}}
    design: {design}
    assumed_attack: {{low: 0.1, high: 1.5, value: 6.0}}
    process_noise: {{std: [0.02, 0.02, 0.01]}}
    initial: {{std: [0.35, 0.35, 1.0]}}
graph: {graph}
attacks:
  - {{scaling: {{low: 0.1, high: 1.5, value: 5.0}}, on: "s*->e*"}}
"""


def load_text(folder: Path, text: str) -> Plan:
    """Return the plan of a topology text, written into a folder."""
    path = folder / "topology.yaml"
    path.write_text(text)
    return load_topology(path).plan


def write_shape(topology: Path, steps: int, out: Path) -> None:
    """Write what the bare network is told of a topology: window, neighbours, and mean sizes of messages."""
    loaded = load_topology(topology, (f"steps={steps}", "expect=null", "attacks=null"))
    plan = loaded.plan
    count: Counter[str] = Counter()
    size: Counter[str] = Counter()

    def weigh(topic: str, message: Message) -> None:
        role, _, rest = topic.partition("/")
        kind = _KINDS[role if role in ("truth", "estimate") else f"{role}/{rest.rpartition('/')[2]}"]
        count[kind] += 1
        size[kind] += len(encode(message))

    run_messages(plan, weigh)
    number = {own.name: index for index, own in enumerate(plan.estimators)}
    shape = {
        "window": loaded.settings.window,
        "neighbours": [sorted(number[name] for name in own.neighbours) for own in plan.estimators],
        "bytes": {kind: round(size[kind] / count[kind]) for kind in count},
    }
    out.write_text(json.dumps(shape))


def run_counting(plan: Plan, note: Callable[[int], None]) -> None:
    """Run a plan in this process, keep nothing, and tell how many steps' worth of estimates there are."""
    estimates = 0
    nodes = len(plan.estimators)

    def sink(topic: str, message: Message) -> None:
        nonlocal estimates
        if topic.startswith("estimate/"):
            estimates += 1
            if estimates % nodes == 0:
                note(estimates // nodes)

    run_messages(plan, sink)
