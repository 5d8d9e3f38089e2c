"""A small world under attack: plant, sensors, what they measure, and how claims about it are judged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from bus.packets import Packet
from nodes.contract import Estimator, Setting
from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.hybrid_bernoulli import HybridBernoulli
from nodes.estimators.packet_sets import FakeBox
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.sensors.linear import Linear as LinearSensor

BOX = FakeBox(-20.0, 20.0)
CHANCES: dict[str, object] = {
    "attack_birth": 0.3,
    "attack_survival": 0.6,
    "delivery": 0.8,
    "substitution": 0.25,
    "initial_attack_probability": 0.4,
}
"""What the filters of this world believe, unless a test says otherwise."""


@dataclass(frozen=True)
class Attackable:
    """A plant of two states under a signal of one or two components, and its sensors."""

    plant: LinearPlant
    sensors: dict[str, LinearSensor]
    prior: list[AttackLaw]

    def setting(self, *names: str) -> Setting:
        heard = {name: self.sensors[name] for name in names or self.sensors}
        return Setting("e1", self.plant, heard, {}, np.random.default_rng(0))

    def filter(self, *names: str, **parameters: object) -> HybridBernoulli:
        defaults = {
            "attack_prior": self.prior,
            "fakes": BOX,
            **CHANCES,
            "pruning": 0.0,
            "merging": 0.0,
            "max_components": 10**6,
        }
        return HybridBernoulli(self.setting(*names), **(defaults | parameters))  # type: ignore[arg-type]


def attackable(q: int = 1) -> Attackable:
    plant = LinearPlant(
        1.0,
        A=[[0.9, 0.3], [-0.2, 0.7]],
        process_noise=Gaussian(covariance=[[0.3, 0.1], [0.1, 0.2]]),
        initial=Gaussian(mean=[1.0, -1.0], covariance=[[2.0, 0.5], [0.5, 1.0]]),
        G=[[1.0, 0.0], [0.5, 1.0]] if q == 2 else [[1.0], [0.5]],
    )
    sensors = {
        "s1": LinearSensor(
            plant,
            C=[[1.0, 0.2], [0.0, 1.0]],
            noise=Gaussian(covariance=[[0.5, 0.1], [0.1, 0.4]]),
            H=[[0.7, 0.0], [0.3, 0.0]] if q == 2 else [[0.7], [0.3]],
        ),
        "s2": LinearSensor(
            plant,
            C=[[0.3, 1.0]],
            noise=Gaussian(std=0.6),
            H=[[0.2, 1.1]] if q == 2 else [[1.1]],
        ),
        "s3": LinearSensor(
            plant,
            C=[[1.0, -1.0]],
            noise=Gaussian(std=0.7),
            H=[[0.9, -0.4]] if q == 2 else [[-0.4]],
        ),
    }
    laws = [AttackLaw(mean=[2.0] * q, std=1.5, weight=3.0), AttackLaw(mean=[-1.0] * q, std=0.8, weight=1.0)]
    return Attackable(plant, sensors, laws)


def packet(step: int, source: str, values: object, sequence: int | None = None) -> Packet:
    number = step if sequence is None else sequence
    return Packet(source, step, number, "measurement", np.array(values, dtype=np.float64))


def trial(
    world: Attackable,
    rng: np.random.Generator,
    steps: int,
    *,
    attacked: Callable[[int], bool] = lambda step: False,
    names: Iterable[str] = ("s1",),
) -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Yield the state and the genuine measurements by sensor of each step, under a signal of 3."""
    q = world.plant.G.shape[1]
    state = world.plant.initial_state(rng)
    for step in range(steps):
        signal = np.full(q, 3.0) * attacked(step)
        if step:
            state = world.plant.advance(step, state, rng, attack=np.full(q, 3.0) * attacked(step - 1))
        yield (
            state,
            {name: world.sensors[name].observe(step, state, rng, attack=signal) for name in names},
        )


class Claims(NamedTuple):
    """Sums over independent runs: NEES of the last steps, NIS of all steps, and the latter's freedom."""

    nees: float
    nis: float
    nis_dof: int


def claims(
    world: Attackable,
    make: Callable[[], Estimator],
    signal_of: Callable[[np.random.Generator, int, int], np.ndarray],
    *,
    runs: int,
    steps: int,
) -> Claims:
    """Run estimators under an attack that never rests; ``signal_of`` takes a generator, seed and step."""
    nees, nis, dof = 0.0, 0.0, 0
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        estimator = make()
        state, before = world.plant.initial_state(rng), np.zeros(1)
        for step in range(steps):
            signal = signal_of(rng, seed, step)
            if step:
                state = world.plant.advance(step, state, rng, attack=before)
            before = signal
            values = world.sensors["s1"].observe(step, state, rng, attack=signal)
            estimator.correct(step, [packet(step, "s1", values)])
            belief = estimator.estimate(step)
            nis += belief.nis
            dof += belief.nis_dof
        error = belief.state - state
        nees += float(error @ np.linalg.solve(belief.covariance, error))
    return Claims(nees, nis, dof)


def assert_chi_squared(total: float, dof: int, false_alarm: float = 1e-6) -> None:
    """Assert that a sum is as large as a chi-squared one: it fails once in ``1 / false_alarm`` times."""
    low, high = chi2.interval(1.0 - false_alarm, df=dof)
    assert low < total < high
