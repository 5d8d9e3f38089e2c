"""What is known of an attack's signal before anything is measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nodes.estimators.gaussian_mixture import Mixture
from nodes.gaussian import Gaussian


@dataclass(frozen=True)
class AttackLaw(Gaussian):
    """A component of the prior of an attack's signal: a Gaussian law, and its ``weight`` among the others."""

    weight: float = 1.0


def prior_mixture(laws: Sequence[AttackLaw], name: str) -> Mixture:
    """Return the prior of the signal; raises ValueError when its components do not fit one another."""
    sizes = {len(law.mean or ()) for law in laws}
    if len(sizes) != 1 or not min(sizes):
        raise ValueError(f"{name}: every law of 'attack_prior' needs a 'mean', all of one length")
    if not all(law.weight > 0.0 and math.isfinite(law.weight) for law in laws):
        raise ValueError(f"{name}: the weights of 'attack_prior' must be positive")
    q = sizes.pop()
    weights = np.array([law.weight for law in laws])
    covariances = np.array([law.covariance_matrix(q) for law in laws])
    if np.linalg.eigvalsh(covariances).min() <= 0.0:
        raise ValueError(f"{name}: a law of 'attack_prior' is singular; give every component a positive std")
    return Mixture(
        np.log(weights / weights.sum()), np.array([law.mean_vector(q) for law in laws]), covariances
    )
