"""Resampling: weighted particles become as many unweighted ones, each as often as its weight says on average.

All schemes are unbiased: the expected number of copies of a particle is N times its weight.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bus.packets import Vector

Indices = NDArray[np.intp]
Scheme = Literal["none", "systematic", "stratified", "residual"]


def effective_sample_size(weights: Vector) -> float:
    """Return ``1 / sum w^2`` of weights (N,) that sum to 1: N when all are equal, 1 when one has all."""
    return float(1.0 / weights.dot(weights))


def systematic(weights: Vector, rng: np.random.Generator) -> Indices:
    """Return the indices (N,) at N equally spaced places with one random offset; needs one draw."""
    size = len(weights)
    return _at(weights, (_strata(size) + rng.random()) / size)


def stratified(weights: Vector, rng: np.random.Generator) -> Indices:
    """Return the indices (N,) at one random place in each of N equal strata."""
    size = len(weights)
    return _at(weights, (_strata(size) + rng.random(size)) / size)


def residual(weights: Vector, rng: np.random.Generator) -> Indices:
    """Return each index ``floor(N w)`` times, and the rest (N in all) by what is left of the weights."""
    size = len(weights)
    expected = size * weights
    copies = np.floor(expected)
    certain = np.repeat(np.arange(size), copies.astype(np.intp))
    missing = size - len(certain)
    if missing <= 0:
        return certain[:size]
    return np.concatenate((certain, _at(expected - copies, rng.random(missing))))


SCHEMES: Mapping[str, Callable[[Vector, np.random.Generator], Indices]] = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
}
"""Schemes by name; each takes weights (N,) that sum to 1."""


def _at(weights: Vector, places: Vector) -> Indices:
    """Return the indices of the weights in whose share of [0, 1) the places lie."""
    cumulative = np.cumsum(weights)
    cumulative /= cumulative[-1]
    return cumulative.searchsorted(places, side="right")


@lru_cache(maxsize=16)
def _strata(size: int) -> Vector:
    """Return 0, 1, ... (size,)."""
    strata = np.arange(size, dtype=np.float64)
    strata.setflags(write=False)
    return strata
