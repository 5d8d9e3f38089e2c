"""What a node knows when it chooses the gains of a distributed filter, and what it assumes of an adversary.

The method is that of Zhou, Zhang, Wang 2020, with designs that need nothing but what a node and its
neighbours know: see docs/zhou2020.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Le

from bus.packets import Vector
from nodes.contract import Matrix

Share = float | list[float]


@dataclass(frozen=True)
class Deception:
    """What a design assumes of an attack ``y~ = (I - Xi) y + Xi v`` on measurements (Zhou 2020, (3)-(5)).

    Parameters
    ----------
    low
        Lower bound of the attack's shares, the diagonal of ``Xi``: one number, or one for each output.
    high
        Likewise, the upper bound. Where a mean and a variance are needed, shares are uniform between the two.
    value
        Bound of each component of ``v``, in units of the measurement.
    probability
        The probability that an output is attacked in a step; where only bounds count, it does not.
    """

    low: Share
    high: Share
    value: Annotated[float, Ge(0.0)]
    probability: Annotated[float, Ge(0.0), Le(1.0)] = 1.0


@dataclass(frozen=True)
class Shares:
    """The attack's shares: ``low``, ``high``, ``mean``, ``variance`` (m,); ``value`` bounds ``|v_s|``."""

    low: Vector
    high: Vector
    mean: Vector
    variance: Vector
    value: float

    @cached_property
    def passed(self) -> Vector:
        """The mean share (m,) of a measurement that is left, ``1 - mean``."""
        return 1.0 - self.mean

    @cached_property
    def passed_square(self) -> Vector:
        """The square (m,) of `passed`."""
        return self.passed * self.passed

    @cached_property
    def coherent(self) -> Vector:
        """Twice the square (m,) of the mean share, times that of the value's bound."""
        return (2.0 * self.value**2) * (self.mean * self.mean)

    @cached_property
    def spread(self) -> Vector:
        """Three times the shares' variance (m,)."""
        return 3.0 * self.variance

    @cached_property
    def unit(self) -> Matrix:
        """The unit matrix (m, m)."""
        return np.eye(len(self.mean))

    @cached_property
    def noise_factor(self) -> Matrix:
        """What multiplies, entry by entry, the covariance (m, m) of a measurement's noise."""
        factor: Matrix = np.outer(self.passed, self.passed) + np.diag(self.variance)
        return factor

    @classmethod
    def of(cls, deception: Deception | None, outputs: int) -> Shares:
        """Return what a deception means for so many outputs; raises ValueError for bounds that do not fit."""
        if deception is None:
            none = np.zeros(outputs)
            return cls(none, none, none, none, 0.0)
        low, high = (np.asarray(bound, dtype=np.float64) for bound in (deception.low, deception.high))
        if any(bound.ndim and bound.shape != (outputs,) for bound in (low, high)):
            raise ValueError(f"'low' and 'high' must have one entry, or one for each of {outputs} outputs")
        low, high = np.broadcast_to(low, outputs).copy(), np.broadcast_to(high, outputs).copy()
        if np.any(low < 0.0) or np.any(low > high):
            raise ValueError(f"'low' {low.tolist()} must not be negative, nor above 'high' {high.tolist()}")
        middle, chance = 0.5 * (low + high), deception.probability
        square = (high - low) ** 2 / 12.0 + middle**2
        # an attack that may rest has shares from 0 on
        least = low if chance == 1.0 else np.zeros(outputs)
        mean = chance * middle
        return cls(least, high, mean, chance * square - mean**2, deception.value)


class Local(NamedTuple):
    """What node i knows in one step of itself and of the M - 1 neighbours that it can use; itself first.

    ``F`` (n, n), ``remainder`` ``U``, ``directions`` ``B`` (n, q) and ``driver`` ``d`` (n,) are the plant's
    linearisation at its own estimate. By member: ``values`` (M, m) and ``slopes`` (M, m, n), the measurement
    and its derivative at the member's estimate; ``remainders`` (M,); ``noise`` (M, m, m), its ``R``;
    ``differences`` (M, n), its own estimate less the member's; ``covariances`` (M, n, n); ``slack`` (M,),
    the bound of the trigger's error ``f' Phi f``, 0 for one that has just sent. ``unsaid`` (m, m) is
    ``Phi^-1``. Without ``measured`` it lacks its own innovation, and may only use the others'.
    """

    F: Matrix
    remainder: float
    directions: Matrix
    driver: Vector
    values: Matrix
    slopes: np.ndarray
    remainders: Vector
    noise: np.ndarray
    differences: Matrix
    covariances: np.ndarray
    slack: Vector
    unsaid: Matrix
    measured: bool

    @property
    def neighbours(self) -> int:
        """The number of neighbours in it that its own innovation is compared with."""
        return len(self.values) - 1 if self.measured else 0


class Gains(NamedTuple):
    """Gains ``[K, C]`` (n, 2 m) of innovation and disagreement, and the bound of the next error (n, n)."""

    matrix: Matrix
    bound: Matrix


class Design(Protocol):
    """A way to choose gains.

    ``guaranteed`` says that the bound holds whatever the adversary does within what is assumed of it;
    ``ellipsoidal`` that it bounds the error itself, ``e' P^-1 e <= 1``, and not its second moment, ``E e e'
    <= P``; ``failures`` counts the programs that could not be solved.
    """

    guaranteed: bool
    ellipsoidal: bool
    failures: int

    def gains(self, local: Local) -> Gains:
        """Return gains and bound for the step that follows."""
        ...


@lru_cache(maxsize=256)
def _sums(members: int, measured: bool) -> tuple[Matrix, Matrix]:
    """Return what makes, of one row a member, innovation and disagreement, then own and others; (2, M)."""
    apart = np.zeros((2, members))
    apart[0, 0] = float(measured)
    apart[1, 1:] = 1.0
    compared = apart.copy()
    compared[1, 0] = -float(members - 1) if measured else 0.0
    return compared, apart


def stacked(by_member: np.ndarray, local: Local) -> Matrix:
    """Return ``sum_j T_j x_j`` (2 m, ...) of one x (m, ...) a member: ``(x_i, sum over N of x_j - x_i)``."""
    members, m = by_member.shape[:2]
    compared, _ = _sums(members, local.measured)
    both: Matrix = compared.dot(by_member.reshape(members, -1)).reshape(2 * m, *by_member.shape[2:])
    return both


def stacked_square(by_member: np.ndarray, local: Local) -> Matrix:
    """Return ``sum_j T_j X_j T_j'`` (2 m, 2 m) of one symmetric X (m, m) a member."""
    members, m = by_member.shape[:2]
    d = float(local.neighbours)
    own, others = _sums(members, local.measured)[1].dot(by_member.reshape(members, -1)).reshape(2, m, m)
    whole = np.empty((2 * m, 2 * m))
    whole[:m, :m] = own
    whole[:m, m:] = whole[m:, :m] = -d * own
    whole[m:, m:] = d * d * own + others
    return whole
