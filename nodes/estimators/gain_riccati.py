"""Gains in closed form for a distributed filter under multiplicative deception.

With ``G = [K C]`` the error follows ``e+ = (F - (I - mu) G H) e + alpha + w`` less what the gains let in: the
remainders of the sensors, the known mean of the attack, its value, the triggers' errors, and noise. Each of
these *groups* has a second moment that a node can bound from what it and its neighbours know.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix
from nodes.estimators.gain_knowledge import Gains, Local, Shares, stacked, stacked_square
from nodes.lapack import dpotrf, dtrtrs

RiccatiVariant = Literal["nominal", "adversarial", "residual"]

_SWEEPS = 40
_SMALLEST_WEIGHT = 1e-9


class Moments(NamedTuple):
    """``slope`` (2 m, n) by which the error enters innovation and disagreement, and the groups beside it.

    ``known`` (2 m,) is the known mean of both. By member, the second moments (M, m, m) of what enters its
    innovation: the sensor's ``remainder``, the attack's ``value``, the ``trigger``'s error and the ``noise``.
    ``drift`` (n, n) is that of the plant's remainder.
    """

    slope: Matrix
    known: Vector
    remainder: np.ndarray
    value: np.ndarray
    trigger: np.ndarray
    noise: np.ndarray
    drift: Matrix

    def groups(self, local: Local) -> tuple[Matrix, ...]:
        """Return the second moments (2 m, 2 m) of the groups that the gains let in."""
        by_member = (self.remainder, self.value, self.trigger, self.noise)
        return (np.outer(self.known, self.known), *(stacked_square(each, local) for each in by_member))


class Riccati:
    """The closed-form design.

    - ``nominal``: the groups are taken as uncorrelated. One linear system; the bound is none against an
      attack that persists.
    - ``adversarial``: whatever their correlation, by Young's inequality ``(sum a)(sum a)' <= sum a a' / pi``
      with ``sum pi = 1``; weights and gains are improved in turn, and compared with no gains at all.
    - ``residual``: as nominal, but all of the attack is counted as a part of the residual: ``z = H e + v +
      Xi (v_a - y)``, where the loop gain is the true one.

    Parameters
    ----------
    shares
        What is assumed of the attack.
    Q
        Covariance (n, n) of the process noise.
    variant
        One of the three.
    """

    ellipsoidal = False
    failures = 0

    def __init__(self, shares: Shares, Q: Matrix, *, variant: RiccatiVariant = "nominal") -> None:
        self.guaranteed = variant == "adversarial"
        self._shares = shares
        self._Q = Q
        self._variant = variant

    def gains(self, local: Local) -> Gains:
        """Return gains and bound for the step that follows."""
        if self._variant == "adversarial":
            return adversarial(local, second_moments(local, self._shares), self._Q)
        sums = residual if self._variant == "residual" else nominal
        slope, disturbance = sums(local, self._shares)
        return best_gains(local, slope, disturbance, self._Q + _drift(local))


def second_moments(local: Local, shares: Shares) -> Moments:
    """Return the groups, with ``1 - mu`` as the gain on the error."""
    passed, members = shares.passed, len(local.values)
    unit = shares.unit
    slopes = passed[:, None] * local.slopes
    shifts = row_sums(slopes * local.differences[:, None, :]) - shares.mean * local.values
    remainder = local.remainders * local.remainders * _heading_variance(local)
    bounds = np.abs(local.values) + shares.value
    own = (3.0 * shares.variance) * (_projected(local) + remainder[:, None] + bounds * bounds)
    value = (2.0 * members * shares.value**2) * (shares.mean * shares.mean)
    return Moments(
        stacked(slopes, local),
        stacked(shifts, local),
        (members * remainder)[:, None, None] * (unit * (passed * passed)),
        np.array([unit * value] * members),
        (members * local.slack)[:, None, None] * local.unsaid,
        local.noise * shares.noise_factor + own[:, :, None] * unit,
        _drift(local),
    )


def nominal(local: Local, shares: Shares) -> tuple[Matrix, Matrix]:
    """Return the slope (2 m, n) of `second_moments`, and the sum (2 m, 2 m) of its groups.

    It is what each step of the nominal design needs, and takes half the time.
    """
    slopes = shares.passed[:, None] * local.slopes
    shifts = row_sums(slopes * local.differences[:, None, :]) - shares.mean * local.values
    remainder = (local.remainders * local.remainders * _heading_variance(local))[:, None]
    bounds = np.abs(local.values) + shares.value
    members = len(bounds)
    diagonals = shares.spread * (_projected(local) + remainder + bounds * bounds)
    diagonals += members * (remainder * shares.passed_square + shares.coherent)
    return stacked(slopes, local), _summed(local, shares, shifts, diagonals, float(members))


def residual(local: Local, shares: Shares) -> tuple[Matrix, Matrix]:
    """Return the slope (2 m, n) and the disturbance (2 m, 2 m) with the true loop gain.

    All of the attack stands in the residual.
    """
    shifts = row_sums(local.slopes * local.differences[:, None, :])
    attacked = shares.variance + shares.mean * shares.mean
    diagonals = attacked * (local.values**2 + shares.value**2 + _projected(local))
    diagonals += (local.remainders * local.remainders * _heading_variance(local))[:, None]
    return stacked(local.slopes, local), _summed(local, shares, shifts, diagonals, 0.5)


def _summed(local: Local, shares: Shares, shifts: Matrix, diagonals: Matrix, silence: float) -> Matrix:
    """Return the sum (2 m, 2 m) of what enters by member.

    Known means ``shifts`` (M, m), uncorrelated ``diagonals`` (M, m), noise, and ``silence`` times what the
    triggers left unsaid.
    """
    by_member = diagonals[:, :, None] * shares.unit
    by_member += local.noise * shares.noise_factor
    by_member += (silence * local.slack)[:, None, None] * local.unsaid
    known = stacked(shifts, local)
    whole = stacked_square(by_member, local)
    whole += known[:, None] * known
    return whole


def row_sums(array: np.ndarray) -> Matrix:
    """Return the sums over the last axis, which is short: by a product, in a third of the time."""
    sums: Matrix = array.dot(_ones(array.shape[-1]))
    return sums


@lru_cache(maxsize=64)
def _ones(size: int) -> Vector:
    return np.ones(size)


def _heading_variance(local: Local) -> np.ndarray:
    """Return ``d' P_j d`` (M,) of each member."""
    spread: np.ndarray = local.covariances.dot(local.driver).dot(local.driver)
    return spread


def _projected(local: Local) -> Matrix:
    """Return the diagonals of ``H_j P_j H_j'`` (M, m)."""
    projected: Matrix = row_sums(np.matmul(local.slopes, local.covariances) * local.slopes)
    return projected


def _drift(local: Local) -> Matrix:
    """Return ``U^2 d' P d B B'`` (n, n)."""
    driven = local.remainder * local.directions
    drift: Matrix = local.driver.dot(local.covariances[0]).dot(local.driver) * driven.dot(driven.T)
    return drift


def best_gains(local: Local, slope: Matrix, disturbance: Matrix, Q: Matrix) -> Gains:
    """Return the gains with the least ``(F - G H) P (F - G H)' + G S G' + Q``, and that bound.

    ``slope`` is ``H`` (2 m, n) and ``disturbance`` ``S`` (2 m, 2 m). An innovation that is missing has rows
    of zeros in both, and its gain is zero.
    """
    F, P = local.F, local.covariances[0]
    onward = F.dot(P)
    crossed = slope.dot(onward.T)
    innovation = slope.dot(P).dot(slope.T) + disturbance
    if not local.neighbours:  # an innovation or a disagreement is missing
        empty = np.flatnonzero(innovation.diagonal() == 0.0)
        innovation[empty, empty] = 1.0
    factor, info = dpotrf(innovation, lower=1)
    if info != 0:
        raise np.linalg.LinAlgError("the innovations' second moment is not positive definite")
    whitened = dtrtrs(factor, crossed, lower=1)[0]
    gains = np.ascontiguousarray(dtrtrs(factor, whitened, lower=1, trans=1)[0].T)
    half = 0.5 * (onward.dot(F.T) - whitened.T.dot(whitened) + Q)
    return Gains(gains, half + half.T)


def adversarial(local: Local, moments: Moments, Q: Matrix) -> Gains:
    """Return gains and a bound that holds whatever the correlation of the groups.

    Weights ``pi`` proportional to the roots of the groups' traces are best for fixed gains, and the gains are
    best for fixed weights; each sweep lowers the trace of the bound.
    """
    m2 = len(moments.slope)
    still = _bound_of(np.zeros((len(Q), m2)), local, moments, Q)
    weights, gains, bound = np.full(7, 1.0 / 7.0), None, still
    for _ in range(_SWEEPS):
        own, drift, *others = weights.tolist()
        disturbance = np.zeros((m2, m2))
        for weight, group in zip(others, moments.groups(local), strict=True):
            disturbance += group / weight
        scaled = local._replace(covariances=local.covariances[:1] / own)
        found, latest = best_gains(scaled, moments.slope, disturbance, Q + moments.drift / drift)
        if gains is not None and np.trace(bound) - np.trace(latest) < 1e-6 * np.trace(latest):
            break
        gains, bound = found, latest
        weights = _weights(_traces(gains, local, moments))
    if gains is None or np.trace(still) <= np.trace(bound):
        return Gains(np.zeros((len(Q), m2)), still)
    return Gains(gains, bound)


def _traces(gains: Matrix, local: Local, moments: Moments) -> np.ndarray:
    """Return the trace of each of the seven groups in the next error."""
    closed = local.F - gains.dot(moments.slope)
    own = np.vdot(closed.dot(local.covariances[0]), closed)
    let_in = [float(np.vdot(gains.dot(group), gains)) for group in moments.groups(local)]
    return np.array([own, np.trace(moments.drift), *let_in])


def _weights(traces: np.ndarray) -> np.ndarray:
    """Return the weights (7,) that sum to one; none is quite zero."""
    roots = np.sqrt(np.maximum(traces, 0.0))
    weights = np.maximum(roots / roots.sum(), _SMALLEST_WEIGHT)
    normalised: np.ndarray = weights / weights.sum()
    return normalised


def _bound_of(gains: Matrix, local: Local, moments: Moments, Q: Matrix) -> Matrix:
    """Return the bound (n, n) of fixed gains under the weights that are best for them."""
    weights = _weights(_traces(gains, local, moments))
    closed = local.F - gains.dot(moments.slope)
    bound = Q + closed.dot(local.covariances[0]).dot(closed.T) / weights[0] + moments.drift / weights[1]
    for weight, group in zip(weights[2:].tolist(), moments.groups(local), strict=True):
        bound = bound + gains.dot(group).dot(gains.T) / weight
    symmetric: Matrix = 0.5 * (bound + bound.T)
    return symmetric
