"""Corrections of a state and an attack signal by measurements, for many components and packets at once.

A component is a Gaussian law of ``(x, a)``: a state (n,) and, under attack, a signal (q,) that stands after
it. A measurement is ``y = g + E ((x, a) - mean) + v``, with the slope ``E = [C, H]`` of each component.

**Unknown signal (``jise``).** Joint input and state estimation as Gillijns and De Moor 2007 derive it takes
the signal as entirely unknown. It is the limit of a Kalman correction under a prior without information, but
its gain needs no such prior: with ``P_x = cov x``, ``S = C P_x C' + R`` and ``M = (H' S^-1 H)^-1 H' S^-1``,

    a = M (y - C x^-),    x = x^- + P_x C' S^-1 (I - H M) (y - C x^-).

Here the gain stands over the innovation that the prior mean of ``a`` gives. Since ``M H = I`` and
``(I - H M) H = 0``, that mean drops out, and so does the prior covariance in Joseph's form.

**When H has not full rank** on the sensors that were heard, a projector ``N`` (q, q) on the directions of the
signal that are still unknown takes the place of the identity: ``F = H N`` stands for ``H``, the
pseudo-inverse of ``F' S^-1 F`` for the inverse, and what is known of the signal counts as part of the state.
``M F`` is then the projector on the directions that this measurement fixes, and ``N - M F`` is left for the
next one. Directions that none fixes keep their prior.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nodes.contract import Matrix
from nodes.estimators.gaussian_mixture import Mixture, Stack, symmetric

_LOG_TWO_PI = math.log(2.0 * math.pi)
_SINGULAR = 1e-10  # relative to the trace of H' S^-1 H


class Linearised(NamedTuple):
    """A map of J Gaussian laws: its mean ``value`` (J, m), and how it depends on the deviations.

    ``slope`` is (J, m, d), or (1, m, d) when all share it; ``spread`` (J, m, m) is the covariance that the
    slope does not explain, None for none.
    """

    value: Matrix
    slope: Stack
    spread: Stack | None = None


class Correction(NamedTuple):
    """J components corrected by each of Z packets.

    ``innovations`` (J, Z, m), ``log_likelihoods`` (J, Z), ``nis`` (J, Z), the ``gain`` (J, d, m), and the
    ``covariances`` (J, d, d) after it, which no packet's content changes. ``free`` (J, q, q) is what stays
    unknown of the signal; None where its prior was used.
    """

    innovations: Stack
    log_likelihoods: Matrix
    nis: Matrix
    gain: Stack
    covariances: Stack
    free: Stack | None


def correct(mixture: Mixture, model: Linearised, noise: Matrix, packets: Matrix, unknown: bool) -> Correction:
    """Correct every component by every packet.

    Parameters
    ----------
    mixture
        The components before.
    model
        The measurement as their laws predict it, under the prior of the signal.
    noise
        Covariance ``R`` (m, m) of the sensor.
    packets
        What arrived (Z, m).
    unknown
        Take the signal as unknown (`jise`), not as its prior tells; the likelihoods use the prior all the
        same, as Forti et al. 2019, (85) do.
    """
    slope, R = model.slope, noise if model.spread is None else noise + model.spread
    projected = np.matmul(slope, mixture.covariances)
    transposed = slope.swapaxes(1, 2)
    factor = np.linalg.cholesky(np.matmul(projected, transposed) + R)
    whitener = np.linalg.inv(factor)
    innovations = packets - model.value[:, None, :]
    whitened = np.matmul(innovations, whitener.swapaxes(1, 2))
    with np.errstate(over="ignore"):
        nis = np.einsum("jzm,jzm->jz", whitened, whitened)
    log_determinant = np.log(factor.diagonal(axis1=1, axis2=2)).sum(axis=1)
    log_likelihoods = -0.5 * (nis + noise.shape[0] * _LOG_TWO_PI) - log_determinant[:, None]
    free = mixture.free
    if unknown and free is not None:
        gain, free = unknown_signal(mixture.covariances, slope, R, free)[:2]
    else:
        gain = np.matmul(np.matmul(whitener, projected).swapaxes(1, 2), whitener)
        free = None
    covariances = joseph(mixture.covariances, gain, slope, R)
    return Correction(innovations, log_likelihoods, nis, gain, covariances, free)


def joseph(covariances: Stack, gain: Stack, slope: Stack, noise: NDArray[np.float64]) -> Stack:
    """Return ``(I - K E) P (I - K E)' + K R K'`` (J, d, d), exactly symmetric."""
    reduction = np.eye(covariances.shape[1]) - np.matmul(gain, slope)
    reduced = np.matmul(np.matmul(reduction, covariances), reduction.swapaxes(1, 2))
    return symmetric(reduced + np.matmul(np.matmul(gain, noise), gain.swapaxes(1, 2)))


class UnknownSignal(NamedTuple):
    """How a measurement fixes an unknown signal: the ``gain`` (J, d, m), and what stays ``free`` (J, q, q).

    ``whitening`` (J, m, m) is ``S^-1 (I - F M)``: of an innovation it takes what the signal cannot explain.
    """

    gain: Stack
    free: Stack
    whitening: Stack


def unknown_signal(
    covariances: Stack, slope: Stack, noise: NDArray[np.float64], free: Stack
) -> UnknownSignal:
    """Return how a measurement fixes a signal of which the directions in ``free`` are unknown."""
    q = free.shape[1]
    n = slope.shape[2] - q
    keep = np.zeros_like(covariances)
    keep[:, :n, :n] = np.eye(n)
    keep[:, n:, n:] = np.eye(q) - free
    known = np.matmul(np.matmul(keep, covariances), keep)
    crossing = np.matmul(known, slope.swapaxes(1, 2))
    S = symmetric(np.matmul(slope, crossing) + noise)
    H = slope[:, :, n:]
    solved = np.linalg.solve(S, np.broadcast_to(H, (len(S), *H.shape[1:])))
    inverse = _inverse_on(free, np.matmul(H.swapaxes(1, 2), solved))
    M = np.matmul(inverse, solved.swapaxes(1, 2))
    F = np.matmul(H, free)
    fixed = np.matmul(M, F)
    whitening = np.linalg.solve(S, np.eye(S.shape[1]) - np.matmul(F, M))
    gain = np.matmul(crossing, whitening)
    gain[:, n:] += M
    return UnknownSignal(gain, symmetric(free - fixed), whitening)


def _inverse_on(free: Stack, information: Stack) -> Stack:
    """Return the pseudo-inverse (J, q, q) of ``N I N``; what is small beside ``I`` itself counts as zero."""
    values, vectors = np.linalg.eigh(symmetric(np.matmul(np.matmul(free, information), free)))
    scale = _SINGULAR * information.trace(axis1=1, axis2=2)[:, None]
    usable = values > scale
    reciprocal = np.where(usable, 1.0 / np.where(usable, values, 1.0), 0.0)
    inverse: Stack = np.matmul(vectors * reciprocal[:, None, :], vectors.swapaxes(1, 2))
    return inverse
