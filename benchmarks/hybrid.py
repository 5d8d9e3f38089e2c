"""What a correction of the hybrid Bernoulli filter costs by components and packets, beside a plain loop."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.comparison import Comparison, at_least, at_most
from benchmarks.effort import Effort
from benchmarks.reference.component_loop import Component, corrected, heaviest
from nodes.estimators.attack_model import LinearMap
from nodes.estimators.gaussian_mixture import Mixture
from nodes.estimators.hybrid_density import Density, Reduction, correct_density, injection

N, Q = 5, 2
DELIVERY, LOG_FAKE = 0.98, -5.0 * math.log(140.6)
SIZES = ((1, 1), (1, 20), (10, 20), (50, 1), (50, 20), (100, 20), (50, 40))
LARGE = (50, 20)
_REPEATS = 40


@dataclass(frozen=True)
class Problem:
    """Two mixtures of as many components, and packets (Z, 5) that all fit some of them."""

    density: Density
    sensor: LinearMap
    slopes: tuple[np.ndarray, np.ndarray]
    packets: np.ndarray

    @property
    def components(self) -> int:
        """The components of each mixture."""
        return self.density.safe.size


def problem(components: int, packets: int) -> Problem:
    """Return a problem of the benchmark plant's size, of which nothing is negligible."""
    rng = np.random.default_rng(0)
    H = np.zeros((N, Q))
    H[2, 0] = H[0, 1] = 1.0

    def mixture(d: int) -> Mixture:
        roots = 0.3 * rng.normal(size=(components, d, d))
        covariances = roots @ roots.swapaxes(1, 2) + 0.1 * np.eye(d)
        return Mixture(
            np.full(components, -math.log(2.0 * components)), rng.normal(size=(components, d)), covariances
        )

    noise = 0.5 * np.eye(N)
    return Problem(
        Density(mixture(N), mixture(N + Q)),
        LinearMap(np.eye(N), H, noise),
        (np.eye(N), np.hstack((np.eye(N), H))),
        rng.normal(size=(packets, N)),
    )


def by_arrays(of: Problem) -> Density:
    """Correct as the estimator does; as many components are kept as there were."""
    origin = injection(DELIVERY, np.full(len(of.packets), LOG_FAKE))
    reduction = Reduction(0.0, 0.0, of.components)
    return correct_density(
        of.density, of.sensor, of.packets, origin, n=N, unknown=False, reduction=reduction
    )[0]


def by_loop(of: Problem) -> tuple[list[Component], list[Component]]:
    """Correct one component and packet after the other."""
    found = [
        corrected(
            list(map(Component, part.log_weights.tolist(), part.means, part.covariances)),
            slope,
            of.sensor.noise,
            of.packets,
            DELIVERY,
            LOG_FAKE,
        )
        for part, slope in zip(of.density, of.slopes, strict=True)
    ]
    return heaviest(found[0], found[1], of.components)


def measure(effort: Effort) -> list[Comparison]:
    """Time all sizes in turn, in this process, by its processor time."""
    problems = {size: problem(*size) for size in SIZES}
    ours: dict[tuple[int, int], list[float]] = {size: [] for size in SIZES}
    loop: list[float] = []
    repeats = effort.steps(_REPEATS)
    for repetition in range(effort.repeats):
        effort.tell(f"hybrid Bernoulli filter, {repetition + 1} of {effort.repeats}")
        for size, each in problems.items():
            ours[size].append(_time_us(lambda each=each: by_arrays(each), repeats))  # type: ignore[misc]
        loop.append(_time_us(lambda: by_loop(problems[LARGE]), 1))
    large = ours[LARGE]
    rows = [
        Comparison("g", _name(size), "µs/correction", samples)
        for size, samples in ours.items()
        if size != LARGE
    ]
    double = Comparison(
        "g", _name((50, 40)), "µs/correction", ours[50, 40], _name(LARGE), large, at_most(2.2)
    )
    return [
        *rows,
        double,
        Comparison(
            "g",
            f"{_name(LARGE)}, a component and a packet at a time",
            "µs/correction",
            loop,
            "as arrays",
            large,
            at_least(5.0),
        ),
    ]


def _name(size: tuple[int, int]) -> str:
    return f"hybrid_bernoulli: 2 x {size[0]} components, {size[1]} packets"


def _time_us(job: Callable[[], object], times: int) -> float:
    """Return the time (µs) of a job, after one run of it to warm up."""
    job()
    began_s = time.process_time()
    for _ in range(times):
        job()
    return 1e6 * (time.process_time() - began_s) / times
