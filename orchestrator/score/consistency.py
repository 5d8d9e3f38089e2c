"""Whether an estimator's covariance tells the truth: NEES and NIS against chi-square bounds.

A consistent filter's NEES ``e' P^-1 e`` has n degrees of freedom and its NIS as many as the step's innovation
has components (Bar-Shalom, Li and Kirubarajan 2001, section 5.4). The bounds on averages hold for independent
samples. NIS samples of a consistent filter are; NEES samples of one run are not, so a mean outside its bounds
is a hint there and no verdict: average NEES over independent trials for that.
"""

from __future__ import annotations

import numpy as np

from orchestrator.score.accuracy import numbers
from orchestrator.score.gather import Bools, Floats, Ints
from orchestrator.score.results import Consistency


def chi_square_bounds(dof: Ints, confidence: float) -> tuple[Floats, Floats]:
    """Return two-sided bounds of chi-square figures with ``dof`` (any shape, positive) degrees of freedom."""
    from scipy.special import gammaincinv  # late: the import takes longer than scoring a run

    tail = (1.0 - confidence) / 2.0
    shape = np.asarray(dof, dtype=np.float64) / 2.0
    low, high = (gammaincinv(shape, share) for share in (tail, 1.0 - tail))
    return np.asarray(2.0 * low, dtype=np.float64), np.asarray(2.0 * high, dtype=np.float64)


def _factor(covariance: Floats) -> Floats:
    """Return lower Cholesky factors (S, n, n), NaN for a matrix that is not positive definite."""
    try:
        return np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    except np.linalg.LinAlgError:
        factors = np.full_like(covariance, np.nan)
        for i, matrix in enumerate(covariance):
            try:
                factors[i] = np.linalg.cholesky(matrix)
            except np.linalg.LinAlgError:
                continue
        return factors


def nees(error: Floats, covariance: Floats, counted: Bools) -> Floats:
    """Return ``e' P^-1 e`` (N, K) of errors (N, K, n) under covariances (N, K, n, n).

    NaN where not ``counted`` (N, K), or where a number is missing or the covariance is not positive definite.
    """
    figures = np.full(counted.shape, np.nan)
    usable = counted & np.isfinite(error).all(axis=2) & np.isfinite(covariance).all(axis=(2, 3))
    factor = _factor(covariance[usable])
    sound = np.isfinite(factor).all(axis=(1, 2)) & (np.diagonal(factor, axis1=1, axis2=2) > 0.0).all(axis=1)
    usable[usable] = sound
    whitened = np.linalg.solve(factor[sound], error[usable][:, :, None])
    figures[usable] = np.sum(np.square(whitened), axis=(1, 2))
    return figures


def share_above(figures: Floats, bound: float) -> float | None:
    """Return the share of known figures that exceed a bound; None when none is known."""
    known = figures[np.isfinite(figures)]
    return float(np.mean(known > bound)) if known.size else None


def consistency(figures: Floats, dof: Ints, counted: Bools, confidence: float) -> list[Consistency]:
    """Return the mean of each row of chi-square figures (N, K) with ``dof`` (N, K), over ``counted`` (N, K).

    A figure that is NaN or has no degree of freedom does not count.
    """
    counted = counted & np.isfinite(figures) & (dof > 0)
    values = np.where(counted, figures, 0.0)
    distinct, place = np.unique(np.maximum(dof, 1), return_inverse=True)
    low, high = (bound[place].reshape(dof.shape) for bound in chi_square_bounds(distinct, confidence))
    samples = counted.sum(axis=1)
    total_dof = np.where(counted, dof, 0).sum(axis=1)
    total_low, total_high = chi_square_bounds(np.maximum(total_dof, 1), confidence)
    inside = (counted & (low <= values) & (values <= high)).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        columns = [
            total / samples for total in (values.sum(axis=1), total_dof, total_low, total_high, inside)
        ]
    rows = np.where(samples > 0, np.array(columns), np.nan).T
    return [
        Consistency(
            samples=count, **dict(zip(("mean", "dof", "low", "high", "inside"), numbers(row), strict=True))
        )
        for count, row in zip(samples.tolist(), rows, strict=True)
    ]
