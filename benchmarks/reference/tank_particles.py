"""The particle filter of Sadeghzadeh-Nokhodberiz 2022 (Table 2) as a plain numpy loop, for the tanks alone.

It does what the published variant of `particle_fdi` does on the measured levels, and no more: no other plant
or sensor, no bus, no checks, no covariance, and an estimate of the attack that is given. One generator.
"""

from __future__ import annotations

import numpy as np

AREAS = np.array([[28.0], [32.0], [28.0], [32.0]])
HOLES = np.array([[0.071], [0.057], [0.071], [0.057]])
FLOW = HOLES * np.sqrt(2.0 * 981.0) / AREAS
GAINS, SPLITS, VOLTAGES = (3.33, 3.35), (0.7, 0.6), (3.0, 3.0)
INFLOW = (
    np.array(
        [
            [SPLITS[0] * GAINS[0] * VOLTAGES[0]],
            [SPLITS[1] * GAINS[1] * VOLTAGES[1]],
            [(1.0 - SPLITS[1]) * GAINS[1] * VOLTAGES[1]],
            [(1.0 - SPLITS[0]) * GAINS[0] * VOLTAGES[0]],
        ]
    )
    / AREAS
)
FED = FLOW[2:] * AREAS[2:] / AREAS[:2]


def rate(levels: np.ndarray) -> np.ndarray:
    """Return the rates of change (4, N) of levels (4, N)."""
    roots = np.sqrt(np.maximum(levels, 0.0))
    change: np.ndarray = INFLOW - FLOW * roots
    change[:2] += FED * roots[2:]
    return change


def moved(levels: np.ndarray) -> np.ndarray:
    """Return the levels (4, N) one second later: one step of the Runge-Kutta method."""
    first = rate(levels)
    second = rate(levels + 0.5 * first)
    third = rate(levels + 0.5 * second)
    fourth = rate(levels + third)
    return levels + (first + 2.0 * (second + third) + fourth) / 6.0


def filtered(
    values: np.ndarray,
    attack: np.ndarray,
    particles: int,
    *,
    initial: np.ndarray,
    noise_std: float = 0.01,
    R: np.ndarray,
    threshold: float,
    share: float = 0.5,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return the estimates (T, 4) of measurements (T, 4), given what the attack adds (T, 4) if it occurs."""
    levels = initial[:, None] + noise_std * rng.standard_normal((4, particles))
    log_weights = np.zeros(particles)
    kept = (R / (R + noise_std**2))[:, None]
    precision = 1.0 / R
    found = np.empty(values.shape)
    for step, value in enumerate(values):
        if step:
            levels = moved(levels) + noise_std * rng.standard_normal((4, particles))
        residuals = value[:, None] - levels
        beta = np.mean(((kept * residuals) ** 2).sum(axis=0) > threshold**2)
        if beta > share:
            residuals -= attack[step][:, None]
        log_weights -= 0.5 * precision.dot(residuals**2)
        log_weights -= log_weights.max()
        weights = np.exp(log_weights)
        weights /= weights.sum()
        found[step] = levels.dot(weights)
    return found
