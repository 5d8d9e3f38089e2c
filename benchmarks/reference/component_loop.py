"""The corrections of the hybrid Bernoulli filter, a component and a packet at a time.

It is written as a textbook reads: a Kalman correction for each pair of a component and a packet, all of them
carried out, then the weights, then the heaviest components.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Component(NamedTuple):
    """One Gaussian of a mixture: the logarithm of its weight, its mean (d,) and its covariance (d, d)."""

    log_weight: float
    mean: np.ndarray
    covariance: np.ndarray


def corrected(
    mixture: Sequence[Component],
    slope: np.ndarray,
    noise: np.ndarray,
    packets: np.ndarray,
    delivery: float,
    log_fake: float,
) -> list[Component]:
    """Return the components (J times 1 + Z) after packets (Z, m) of which one at most is genuine."""
    found = []
    for component in mixture:
        P = component.covariance
        found.append(component._replace(log_weight=component.log_weight + math.log(1.0 - delivery)))
        for packet in packets:
            innovation = packet - slope @ component.mean
            S = slope @ P @ slope.T + noise
            gain = np.linalg.solve(S, slope @ P).T
            reduction = np.eye(len(P)) - gain @ slope
            log_likelihood = -0.5 * (
                innovation @ np.linalg.solve(S, innovation) + np.linalg.slogdet(2.0 * math.pi * S)[1]
            )
            found.append(
                Component(
                    component.log_weight
                    + math.log(delivery)
                    - math.log(len(packets))
                    - log_fake
                    + float(log_likelihood),
                    component.mean + gain @ innovation,
                    reduction @ P @ reduction.T + gain @ noise @ gain.T,
                )
            )
    return found


def heaviest(
    safe: Sequence[Component], attacked: Sequence[Component], most: int
) -> tuple[list[Component], list[Component]]:
    """Return the heaviest components of both mixtures, with a total weight of one; each keeps its share."""
    largest = max(component.log_weight for component in (*safe, *attacked))
    total = largest + math.log(
        sum(math.exp(component.log_weight - largest) for component in (*safe, *attacked))
    )
    kept = []
    for mixture in (safe, attacked):
        ordered = sorted(mixture, key=lambda component: -component.log_weight)
        share = [math.exp(component.log_weight - ordered[0].log_weight) for component in ordered]
        missing = math.log(sum(share) / sum(share[:most]))
        kept.append(
            [
                component._replace(log_weight=component.log_weight + missing - total)
                for component in ordered[:most]
            ]
        )
    return kept[0], kept[1]
