"""What an innovation consists of, as affine forms of everything that is bounded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix
from nodes.estimators.gain_knowledge import Local, Shares, stacked

NOISE_RADIUS = 2.0
"""Squared radius of the ellipsoid of measurement noise, in standard deviations."""


class Form(NamedTuple):
    """An affine form (m,) of what is bounded: its constant ``one`` (m,), and a matrix (m, .) a part."""

    one: Vector
    error: Matrix
    remainder: Matrix
    noise: Matrix
    value: Matrix


class MemberForms:
    """What the members' innovations consist of, in scaled variables.

    ``selections`` are the ``T_j`` (2 m, m). ``drives`` are what bounds each remainder: a row (1 + n,) of a
    length of about one.
    """

    def __init__(self, local: Local, shares: Shares, factor: Matrix) -> None:
        m = len(shares.mean)
        self._local, self._shares, self._factor = local, shares, factor
        self.selections = []
        for j in range(len(local.values)):
            one = np.zeros((len(local.values), m, m))
            one[j] = np.eye(m)
            self.selections.append(stacked(one, local))
        heading = float(np.sqrt(local.driver @ local.covariances[0] @ local.driver))
        apart = local.differences @ local.driver
        self._units = heading + np.abs(apart)
        along = factor.T @ local.driver
        self.drives = [
            np.concatenate(([off], along)) / unit for off, unit in zip(apart, self._units, strict=True)
        ]

    def _genuine(self, j: int) -> Form:
        """Return ``H (e + D) + b + v``: the genuine measurement less what the member predicts."""
        local, m = self._local, len(self._shares.mean)
        H = local.slopes[j]
        return Form(
            H @ local.differences[j],
            H @ self._factor,
            local.remainders[j] * self._units[j] * np.eye(m),
            np.linalg.cholesky(NOISE_RADIUS * local.noise[j]),
            np.zeros((m, m)),
        )

    def replaced(self, j: int) -> Form:
        """Return ``v_a - y``: what the attack puts in place of a genuine measurement, less that."""
        one, error, remainder, noise, _ = self._genuine(j)
        value = self._shares.value * np.eye(len(one))
        return Form(-one - self._local.values[j], -error, -remainder, -noise, value)

    def measured(self, j: int, share: Vector) -> Form:
        """Return the innovation when the attack's shares (m,) are these."""
        genuine, other = self._genuine(j), self.replaced(j)
        return Form(
            genuine.one + share * other.one,
            *(part + share[:, None] * more for part, more in zip(genuine[1:], other[1:], strict=True)),
        )

    def reach(self, j: int) -> Vector:
        """Return about the largest absolute value (m,) of `replaced`."""
        form = self.replaced(j)
        parts = [np.sqrt((part**2).sum(axis=1)) for part in form[1:]]
        reach: Vector = np.abs(form.one) + np.sum(parts, axis=0)
        return reach
