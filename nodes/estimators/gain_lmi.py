"""Gains that each node finds by a semidefinite program of its own, from what it and its neighbours know."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix
from nodes.estimators.gain_forms import MemberForms
from nodes.estimators.gain_knowledge import Gains, Local, Shares
from nodes.estimators.gain_programs import (
    Columns,
    Program,
    Sizes,
    Solution,
    Solver,
    bounded_program,
    nominal_program,
    require_solvers,
)
from nodes.estimators.gain_riccati import Riccati, nominal
from nodes.linear_algebra import square_root

LmiVariant = Literal["nominal", "moment", "sector"]

PROCESS_RADIUS = 3.0
"""Squared radius of the ellipsoid of process noise, in standard deviations."""


def as_moments(local: Local) -> Local:
    """Return the same with ellipsoids ``e' P^-1 e <= 1`` turned into second moments ``P / n``.

    Bounds of remainders grow with the lengths of errors, and are turned along.
    """
    n = len(local.F)
    root = np.sqrt(n)
    return local._replace(
        covariances=local.covariances / n,
        remainder=local.remainder / root,
        remainders=local.remainders / root,
    )


class Scaled(NamedTuple):
    """``factor`` L (n, n) with ``e = L e'``, and ``units`` (n,) in which the next error is measured."""

    factor: Matrix
    units: Vector


def scaled(local: Local, Q: Matrix) -> Scaled:
    """Return the scales of a step: the error's own, and that of a prediction without measurements."""
    P = local.covariances[0]
    if not np.isfinite(P).all():
        raise np.linalg.LinAlgError("the bound of the error is not finite")
    return Scaled(np.linalg.cholesky(P), np.sqrt(np.diag(local.F @ P @ local.F.T + Q)))


class Lmi:
    """The design by semidefinite programs. Its bounds are ellipsoids: ``e' P^-1 e <= 1``.

    - ``nominal``: cross terms are dropped, as in the nominal closed form; ``E e' P^-1 e <= 1`` is claimed.
    - ``moment``: shares are random with known mean and variance, all else is only bounded; ``E e' P^-1 e <=
      1`` over the shares.
    - ``sector``: everything is only bounded, and ``e' P^-1 e <= 1`` holds for each error.

    A program that cannot be solved is counted, and its step has gains in closed form: those of the nominal
    design, or none at all (`dead_reckoning_bound`) where the bound is guaranteed.

    Parameters
    ----------
    shares
        What is assumed of the attack.
    Q
        Covariance (n, n) of the process noise.
    variant
        One of the three.
    members
        The node and its neighbours, counted.
    weights
        Weight (n,) of each state component in the size of the bound.
    solver
        The program that solves.

    Raises
    ------
    ValueError
        When cvxpy or Clarabel is not installed.
    """

    ellipsoidal = True

    def __init__(
        self,
        shares: Shares,
        Q: Matrix,
        *,
        variant: LmiVariant,
        members: int,
        weights: Vector,
        solver: Solver = "CLARABEL",
    ) -> None:
        require_solvers()
        self.guaranteed = variant != "nominal"
        self.failures = 0
        self._shares, self._Q, self._variant = shares, Q, variant
        self._members, self._weights, self._solver = members, weights, solver
        self._fallback = Riccati(shares, Q)

    def gains(self, local: Local) -> Gains:
        """Return gains and bound for the step that follows."""
        found = self.solution(local)
        if found is None:
            self.failures += 1
            return self._without_program(local)
        units = scaled(local, self._Q).units
        bound = units[:, None] * found.bound * units
        return Gains(units[:, None] * found.gains, 0.5 * (bound + bound.T))

    def program(self, local: Local) -> tuple[Program, Mapping[str, np.ndarray]]:
        """Return the program, and its parameters in this step."""
        n, q = local.directions.shape
        sizes = Sizes(n, len(self._shares.mean), q, self._members)
        if self._variant == "nominal":
            return nominal_program(sizes), self._nominal(local)
        sector = self._variant == "sector"
        return bounded_program(sizes, sector=sector), self._bounded(local, sizes, sector=sector)

    def solution(self, local: Local) -> Solution | None:
        """Return the program's solution in scaled variables, None when it has none."""
        program, parameters = self.program(local)
        return program.solve(parameters, self._solver)

    def _without_program(self, local: Local) -> Gains:
        if self.guaranteed:
            return dead_reckoning_bound(local, self._Q, 2 * len(self._shares.mean))
        found = self._fallback.gains(as_moments(local))
        return Gains(found.matrix, len(local.F) * found.bound)

    def _costs(self, units: Vector) -> Vector:
        costs: Vector = self._weights * units * units
        normalised: Vector = costs / costs.sum()
        return normalised

    def _nominal(self, local: Local) -> dict[str, np.ndarray]:
        """Return the parameters of the nominal program."""
        factor, units = scaled(local, self._Q)
        slope, disturbance = nominal(as_moments(local), self._shares)
        driver = factor.T @ local.driver
        return {
            "F": local.F @ factor / units[:, None],
            "H": slope @ factor,
            "drift": local.remainder * local.directions / units[:, None],
            "driver": np.outer(driver, driver),
            "S": square_root(disturbance),
            "Q": square_root(self._Q) / units[:, None],
            "weights": self._costs(units),
        }

    def _bounded(self, local: Local, sizes: Sizes, *, sector: bool) -> dict[str, np.ndarray]:
        """Return the parameters of the program over everything that is bounded."""
        factor, units = scaled(local, self._Q)
        columns = Columns(sizes, sector=sector)
        forms = MemberForms(local, self._shares, factor)
        share = self._shares.low if sector else self._shares.mean
        n, m = sizes.states, sizes.outputs
        opened, let_in = np.zeros((n, columns.total)), np.zeros((2 * m, columns.total))
        heading = float(np.sqrt(local.driver @ local.covariances[0] @ local.driver))
        unsaid = np.linalg.cholesky(local.unsaid)
        opened[:, columns.error] = local.F @ factor
        opened[:, columns.process] = np.linalg.cholesky(PROCESS_RADIUS * self._Q)
        opened[:, columns.drift] = local.remainder * heading * local.directions
        driven = np.zeros(((1 + n) ** 2, 1 + sizes.members))
        own = np.concatenate(([0.0], factor.T @ local.driver)) / heading
        driven[:, 0] = np.outer(own, own).ravel()
        for j in range(len(local.values)):
            driven[:, 1 + j] = np.outer(forms.drives[j], forms.drives[j]).ravel()
        parameters = {"open": opened / units[:, None], "driven": driven, "weights": self._costs(units)}
        parameters["let_in"] = let_in
        for j, selected in enumerate(forms.selections):
            form = forms.measured(j, share)
            let_in[:, columns.one] -= selected @ form.one[:, None]
            let_in[:, columns.error] -= selected @ form.error
            for name in ("remainder", "noise", "value"):
                let_in[:, columns.of(name, j, m)] = -selected @ getattr(form, name)
            let_in[:, columns.of("trigger", j, m)] = np.sqrt(local.slack[j]) * selected @ unsaid
        if sector:
            parameters["sectors"] = self._sectors(forms, columns, sizes, let_in)
        else:
            parameters |= self._residuals(forms, sizes)
        return parameters

    def _sectors(self, forms: MemberForms, columns: Columns, sizes: Sizes, let_in: Matrix) -> Matrix:
        """Return the linear forms of the sectors, and let each phi in, in units of its largest value."""
        m = sizes.outputs
        found = np.zeros((sizes.members * m, columns.total))
        width = self._shares.high - self._shares.low
        for j, selected in enumerate(forms.selections):
            rows = slice(j * m, (j + 1) * m)
            form, reach = forms.replaced(j), forms.reach(j)
            let_in[:, columns.of("sector", j, m)] = -selected * (width * reach)
            scale = np.where(width > 0.0, 1.0 / reach, 0.0)[:, None]
            found[rows, columns.one] = scale * form.one[:, None]
            found[rows, columns.error] = scale * form.error
            for name in ("remainder", "noise", "value"):
                found[rows, columns.of(name, j, m)] = scale * getattr(form, name)
        return found

    def _residuals(self, forms: MemberForms, sizes: Sizes) -> dict[str, np.ndarray]:
        """Return what each share multiplies, squared, and how its channel enters the gains."""
        m = sizes.outputs
        squares = np.zeros(((1 + sizes.states + 3 * m) ** 2, sizes.members * m))
        entries = np.zeros((2 * m, sizes.members * m))
        deviation = np.sqrt(self._shares.variance)
        for j, selected in enumerate(forms.selections):
            form, reach = forms.replaced(j), forms.reach(j)
            rows = np.concatenate(
                (form.one[:, None], form.error, form.remainder, form.noise, form.value), axis=1
            )
            for s in range(m):
                row = rows[s] / reach[s]
                squares[:, j * m + s] = np.outer(row, row).ravel()
                entries[:, j * m + s] = deviation[s] * reach[s] * selected[:, s]
        return {"residuals": squares, "channels": entries}


def dead_reckoning_bound(local: Local, Q: Matrix, columns: int) -> Gains:
    """Return no gains at all, and the least ellipsoid around the sum of the three that then remain.

    These are the propagated error, the plant's remainder and the process noise; for weights that sum to one
    ``sum P_l / pi_l`` contains the sum of the ellipsoids ``P_l``, and its trace is least for weights
    proportional to the roots of the traces (Kurzhanski and Valyi 1997).
    """
    P, B = local.covariances[0], local.directions
    variance = local.driver @ P @ local.driver
    parts = [local.F @ P @ local.F.T, local.remainder**2 * variance * (B @ B.T), PROCESS_RADIUS * Q]
    roots = [float(np.sqrt(np.trace(part))) for part in parts]
    bound = sum(roots) * sum(
        (part / root for part, root in zip(parts, roots, strict=True) if root > 0.0), np.zeros_like(P)
    )
    return Gains(np.zeros((len(P), columns)), 0.5 * (bound + bound.T))
