"""Row g: what a node's step costs in one process, in a large network and in a small one, and by method."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from threadpoolctl import threadpool_limits

from benchmarks import deception, hybrid, particles
from benchmarks.comparison import Comparison, at_most
from benchmarks.effort import Effort
from benchmarks.networks import load_text, network, ring, run_counting, tanks
from bus import keys
from bus.messages import Inbox, Message
from bus.packets import Packet, packets_of_inbox
from bus.plan import Plan
from nodes.build import build_estimator, build_plant, build_sensor
from nodes.contract import Estimator
from orchestrator.backends.inprocess import run_messages

LARGE, SMALL = 200, 20
_NODE_STEPS = 16000
_METHOD_STEPS = 200
_GAIN = "[0.4177, 0.5799, 0.4029]"
METHODS = {
    "secure_distributed": "{method: secure_distributed, coupling: 0.004, threshold: 25}",
    "secure_distributed, detector off": "{method: secure_distributed, coupling: 0.004, detector: 'off'}",
    "fixed_gain_consensus": f"{{method: fixed_gain_consensus, coupling: 0.004, gain: {_GAIN}}}",
    "kalman": "{method: kalman}",
    "kalman_centralized, 20 sensors": "{method: kalman_centralized}",
}
TANK_METHODS = {
    "extended_kalman, tanks": "{method: extended_kalman, sensors: [s1]}",
    "unscented_kalman, tanks": "{method: unscented_kalman, sensors: [s1]}",
}


def measure(rows: frozenset[str], effort: Effort) -> list[Comparison]:
    """Time everything in turn, in this process, by its processor time."""
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(limits=1, user_api="blas"):
        large, small = (
            load_text(Path(folder), network(nodes, effort.steps(_NODE_STEPS // nodes), ring(nodes)))
            for nodes in (LARGE, SMALL)
        )
        methods = {name: _method_plan(Path(folder), text, effort) for name, text in METHODS.items()}
        steps = effort.steps(_METHOD_STEPS)
        methods |= {name: load_text(Path(folder), tanks(steps, text)) for name, text in TANK_METHODS.items()}
    samples: dict[str, list[float]] = {name: [] for name in ("large", "small", *methods)}
    for repetition in range(effort.repeats):
        effort.tell(f"node steps, {repetition + 1} of {effort.repeats}")
        samples["large"].append(_whole_us(large))
        samples["small"].append(_whole_us(small))
        for name, plan in methods.items():
            samples[name].append(_method_us(plan))
    with threadpool_limits(limits=1, user_api="blas"):
        particle_rows = particles.measure(effort)
        hybrid_rows = hybrid.measure(effort)
        deception_rows = deception.measure(effort, _method_us)
    unit = "µs/node step"
    by_size = Comparison(
        "g",
        f"{LARGE} nodes in one process, no log",
        unit,
        samples["large"],
        f"{SMALL} nodes",
        samples["small"],
        at_most(1.3),
    )
    return [
        by_size,
        *(Comparison("g", f"{name}: mathematics alone", unit, samples[name]) for name in methods),
        *particle_rows,
        *hybrid_rows,
        *deception_rows,
    ]


def _method_plan(folder: Path, estimator: str, effort: Effort) -> Plan:
    return load_text(folder, network(SMALL, effort.steps(_METHOD_STEPS), ring(SMALL), estimator=estimator))


def _whole_us(plan: Plan) -> float:
    """Return the time of one node's step (µs) with all that belongs to it: sensor, channel, messages."""
    first: list[float] = []

    def note(whole: int) -> None:
        if whole == 1:
            first.append(time.process_time())

    run_counting(plan, note)
    taken_s = time.process_time() - first[0]
    return 1e6 * taken_s / (len(plan.estimators) * (plan.steps - 1))


def _method_us(plan: Plan) -> float:
    """Return the time (µs) that an estimator's own methods take in one step."""
    received: dict[str, list[list[Packet]]] = {}

    def keep(topic: str, message: Message) -> None:
        if isinstance(message, Inbox):
            received.setdefault(topic, []).append(packets_of_inbox(message))

    run_messages(plan, keep)
    plant = build_plant(plan)
    sensors = {sensor.name: build_sensor(plan, sensor.name, plant) for sensor in plan.sensors}
    taken_s = 0.0
    for own in plan.estimators:
        estimator = build_estimator(plan, own, plant, sensors)
        corrections = received[keys.rx(own.name, keys.CORRECT)]
        exchanges = received.get(keys.rx(own.name, keys.EXCHANGE), [])
        taken_s += _replay_s(estimator, corrections, exchanges)
    return 1e6 * taken_s / (len(plan.estimators) * plan.steps)


def _replay_s(
    estimator: Estimator, corrections: Sequence[Sequence[Packet]], exchanges: Sequence[Sequence[Packet]]
) -> float:
    """Return the time (s) in which an estimator takes all its packets once more."""
    rounds = estimator.rounds
    began_s = time.process_time()
    for step, packets in enumerate(corrections):
        estimator.correct(step, packets)
        for round_ in range(rounds):
            estimator.exchange(step, round_, exchanges[step * rounds + round_])
        estimator.estimate(step)
    return time.process_time() - began_s
