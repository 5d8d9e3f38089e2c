"""What a step of the particle filter that detects false data costs, beside a plain numpy loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.comparison import Comparison, at_most
from benchmarks.effort import Effort
from benchmarks.reference.tank_particles import filtered
from bus.packets import ORACLE, Packet
from bus.random_streams import random_stream, sequential_streams
from nodes.contract import Setting
from nodes.estimators.particle_fdi import ParticleFdi
from nodes.gaussian import Gaussian
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.sensors.linear import Linear

SIZES = (100, 10_000)
R = 1e-3 * np.array([1.0, 1.0, 0.5, 0.5])
THRESHOLD = 0.7 / 3.0
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "particle_fdi as published": {"resampling": "none", "attack_estimate": "oracle"},
    "particle_fdi": {},
}
_STEPS = 200


@dataclass(frozen=True)
class Attacked:
    """Measurements (T, 4) of the tanks with a bias on half of them, and the bias (T, 4)."""

    plant: QuadrupleTank
    sensor: Linear
    values: np.ndarray
    bias: np.ndarray


def attacked(steps: int) -> Attacked:
    """Return measurements of the paper's example."""
    plant = QuadrupleTank(1.0)
    sensor = Linear(plant, C=np.eye(4).tolist(), noise=Gaussian(covariance=np.diag(R).tolist()))
    rng = random_stream(0, 0, "benchmark", "measurements")
    state = plant.initial_state(rng)
    values = []
    for step in range(steps):
        state = plant.advance(step, state, rng) if step else state
        values.append(sensor.observe(step, state, rng))
    bias = 0.5 * (1.0 - 0.9 ** np.arange(steps))[:, None].repeat(4, axis=1)
    occurs = rng.random((steps, 1)) < 0.5
    return Attacked(plant, sensor, np.array(values) + occurs * bias, bias)


def by_estimator(of: Attacked, particles: int, variant: str) -> Callable[[], list[np.ndarray]]:
    """Return a job that gives an estimator all packets and returns its estimates."""
    rng = random_stream(0, 0, "e1", "estimator")
    setting = Setting("e1", of.plant, {"s1": of.sensor}, {}, rng, told_attacks=True)
    options = VARIANTS[variant]
    estimator = ParticleFdi(setting, minimum_attack=0.28, particles=particles, **options)
    received = [
        [Packet("s1", step, step, "measurement", value), Packet("s1", step, step, ORACLE, bias)]
        for step, (value, bias) in enumerate(zip(of.values, of.bias, strict=True))
    ]

    def job() -> list[np.ndarray]:
        estimates = []
        for step, packets in enumerate(received):
            estimator.correct(step, packets)
            estimates.append(estimator.estimate(step).state)
        return estimates

    return job


def by_loop(of: Attacked, particles: int) -> Callable[[], np.ndarray]:
    """Return a job that does the same by the plain loop, with the same draws."""
    rng, *_ = sequential_streams(random_stream(0, 0, "e1", "estimator"), 3)
    initial = of.plant.initial_mean
    return lambda: filtered(of.values, of.bias, particles, initial=initial, R=R, threshold=THRESHOLD, rng=rng)


def measure(effort: Effort) -> list[Comparison]:
    """Time the estimator and the loop in turn, in this process, by its processor time."""
    of = attacked(effort.steps(_STEPS))
    ours: dict[tuple[str, int], list[float]] = {(v, n): [] for n in SIZES for v in VARIANTS}
    loop: dict[int, list[float]] = {size: [] for size in SIZES}
    for repetition in range(effort.repeats):
        effort.tell(f"particle filters, {repetition + 1} of {effort.repeats}")
        for size in SIZES:
            loop[size].append(_step_us(by_loop(of, size), of))
            for variant in VARIANTS:
                ours[variant, size].append(_step_us(by_estimator(of, size, variant), of))
    return [
        Comparison(
            "g",
            f"{variant}, {size:,} particles: mathematics alone",
            "µs/node step",
            samples,
            f"plain numpy, {size:,} particles",
            loop[size],
            at_most(2.0),
        )
        for (variant, size), samples in ours.items()
    ]


def _step_us(job: Callable[[], object], of: Attacked) -> float:
    """Return the time (µs) of a step of a job."""
    began_s = time.process_time()
    job()
    return 1e6 * (time.process_time() - began_s) / len(of.values)
