"""A likelihood as a quadratic: what a particle filter can tell its neighbours of its own measurement."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix

_ROUNDING = 1e-9


class Summary(NamedTuple):
    """A log-likelihood ``g' (x - c) - (x - c)' L (x - c) / 2`` of the state, but for a constant.

    ``centre`` c (n,), ``gradient`` g (n,), ``information`` L (n, n), symmetric and positive semidefinite. A
    linear sensor with Gaussian noise has ``L = C' R^-1 C`` and ``g = C' R^-1 (y - C c)``.
    """

    centre: Vector
    gradient: Vector
    information: Matrix


def terms(n: int) -> int:
    """Return the number of terms of a quadratic of n variables, and of the numbers fitted."""
    return (n + 1) * (n + 2) // 2


def payload_size(n: int) -> int:
    """Return the size of a packed summary."""
    return 2 * n + n * (n + 1) // 2


def summarise(states: Matrix, log_likelihood: Vector) -> Summary | None:
    """Return the quadratic nearest to a log-likelihood (N,) at N states (N, n), by least squares.

    It is the approximation of likelihood consensus (Hlinka, Sluciak, Hlawatsch, Djuric, Rupp 2012,
    "Likelihood consensus and its application to distributed particle filtering", IEEE Trans. Signal Process.
    60(8)) with monomials up to the second degree: exact where the log-likelihood is a quadratic of the state.
    Curvature of the wrong sign, which no density over all states has, is taken out. None when fewer states
    than there are terms have a finite likelihood.
    """
    n = states.shape[1]
    finite = np.isfinite(log_likelihood)
    if np.count_nonzero(finite) < terms(n):
        return None
    points, values = states[finite], log_likelihood[finite]
    centre: Vector = points.mean(axis=0)
    spread = points.std(axis=0)
    scale = np.where(spread > _ROUNDING * np.maximum(np.abs(centre), spread.max()), spread, 1.0)
    offsets = (points - centre) / scale
    rows, columns = np.triu_indices(n)
    design = np.column_stack((np.ones(len(points)), offsets, offsets[:, rows] * offsets[:, columns]))
    fitted = np.linalg.lstsq(design, values - values.max(), rcond=_ROUNDING)[0]
    half = np.zeros((n, n))
    half[rows, columns] = fitted[n + 1 :]
    information = -(half + half.T) / np.outer(scale, scale)
    eigenvalues, vectors = np.linalg.eigh(information)
    information = (vectors * np.maximum(eigenvalues, 0.0)).dot(vectors.T)
    return Summary(centre, fitted[1 : n + 1] / scale, information)


def evaluate(summary: Summary, states: Matrix) -> Vector:
    """Return the log-likelihood (N,) of each of N states (N, n), but for a constant."""
    offsets = states - summary.centre
    slope = summary.gradient - 0.5 * offsets.dot(summary.information)
    values: Vector = np.einsum("ij,ij->i", offsets, slope)
    return values


def packed(summary: Summary) -> Vector:
    """Return a summary as a payload: centre (n), gradient (n), and the upper triangle of the information."""
    upper = summary.information[np.triu_indices(len(summary.centre))]
    return np.concatenate((summary.centre, summary.gradient, upper))


def unpacked(payload: Vector, n: int) -> Summary | None:
    """Return the summary of a payload; None for one of another size, or that is no likelihood's."""
    if payload.size != payload_size(n):
        return None
    information: Matrix = np.zeros((n, n))
    rows, columns = np.triu_indices(n)
    information[rows, columns] = information[columns, rows] = payload[2 * n :]
    eigenvalues = np.linalg.eigvalsh(information)
    if eigenvalues[0] < -_ROUNDING * max(eigenvalues[-1], 0.0):
        return None
    return Summary(payload[:n], payload[n : 2 * n], information)
