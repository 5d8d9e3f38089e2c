"""The semidefinite programs that the gains of a distributed filter come from, built once for each size.

Everything that changes from step to step is a parameter, and enters affinely (disciplined parametrised
programming), so a program is compiled once and then only solved anew. No solve knows of another: gains depend
on the parameters alone. Variables are scaled: the error by the factor of its covariance, the next error by
what it would be without measurements.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Literal, NamedTuple

import numpy as np

from bus.extras import installing
from nodes.contract import Matrix

Solver = Literal["CLARABEL", "SCS"]

SLACK = -1e-8
"""Least eigenvalue that the matrix inequalities of a solution may have."""
MARGINS = (1e-7, 1e-6, 1e-5)
"""Least eigenvalues that the programs ask for, in turn, until a solution is short of `SLACK` no more."""


def require_solvers() -> None:
    """Raise ValueError unless what solves the programs is installed."""
    missing = [name for name in ("cvxpy", "clarabel") if find_spec(name) is None]
    if missing:
        raise ValueError(
            f"design family 'lmi' needs {' and '.join(missing)}: {installing('lmi')}, "
            "or use the family 'riccati'"
        )


def _cvxpy() -> Any:
    """Return cvxpy, which takes a second to import and may not be installed."""
    return import_module("cvxpy")


class Sizes(NamedTuple):
    """``states`` n, ``outputs`` m, ``drift`` q (components of the plant's remainder), ``members`` M."""

    states: int
    outputs: int
    drift: int
    members: int


class Solution(NamedTuple):
    """Scaled gains (n, 2 m) and bound (n, n), the bound's ``cost``, and the least eigenvalue ``slack``."""

    gains: Matrix
    bound: Matrix
    cost: float
    slack: float


class Program:
    """One compiled program.

    Parameters
    ----------
    parts
        Its ``parameters`` by name, the variables ``gains`` and ``bound``, the ``inequalities`` (matrices that
        are to be positive semidefinite), the other ``constraints`` and the ``cost``.
    """

    def __init__(self, parts: Mapping[str, Any]) -> None:
        cp = _cvxpy()
        self.parameters: dict[str, Any] = parts["parameters"]
        self._gains, self._bound = parts["gains"], parts["bound"]
        self._inequalities = parts["inequalities"]
        self._margin = cp.Parameter(nonneg=True)
        constraints = [
            inequality >> self._margin * np.eye(inequality.shape[0]) for inequality in self._inequalities
        ]
        self.problem = cp.Problem(cp.Minimize(parts["cost"]), constraints + parts["constraints"])

    def solve(self, values: Mapping[str, np.ndarray], solver: Solver = "CLARABEL") -> Solution | None:
        """Return the solution for parameters, None when there is none that can be relied on."""
        for name, value in values.items():
            self.parameters[name].value = value
        for margin in MARGINS:
            self._margin.value = margin
            found = self._solved(solver)
            if found is None or found.slack >= SLACK:
                return found
        return None

    def _solved(self, solver: Solver) -> Solution | None:
        """Return the solution of the program as it is, None when the solver finds none."""
        cp = _cvxpy()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # of low accuracy: the slack tells
                self.problem.solve(solver=solver, warm_start=False, **_OPTIONS[solver])
        except (cp.SolverError, ArithmeticError):
            return None
        if self.problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
            return None
        slack = min(
            float(np.linalg.eigvalsh(0.5 * (value + value.T))[0])
            for value in (inequality.value for inequality in self._inequalities)
        )
        return Solution(np.array(self._gains.value), np.array(self._bound.value), self.problem.value, slack)


_OPTIONS: dict[Solver, dict[str, Any]] = {
    "CLARABEL": {"max_threads": 1},
    "SCS": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iters": 200_000},
}


@lru_cache(maxsize=32)
def nominal_program(sizes: Sizes) -> Program:
    """Return the program without cross terms, whose size does not depend on the number of neighbours.

    Parameters: ``F`` (n, n), ``H`` (2 m, n), ``drift`` (n, q), ``driver`` (n, n), ``S`` (2 m, 2 m), ``Q`` (n,
    n), ``weights`` (n,); ``S`` and ``Q`` are roots.
    """
    cp = _cvxpy()
    n, m2, q = sizes.states, 2 * sizes.outputs, sizes.drift
    shapes = {"F": (n, n), "H": (m2, n), "drift": (n, q), "driver": (n, n), "S": (m2, m2), "Q": (n, n)}
    given = {name: cp.Parameter(shape) for name, shape in shapes.items()}
    weights = cp.Parameter(n, nonneg=True)
    bound, gains = cp.Variable((n, n), symmetric=True), cp.Variable((n, m2))
    own, remainder = cp.Variable(nonneg=True), cp.Variable(nonneg=True)
    noise, process = cp.Variable((m2, m2), symmetric=True), cp.Variable((n, n), symmetric=True)
    error, let_in = given["F"] - gains @ given["H"], gains @ given["S"]
    drift = given["drift"]
    inequalities = [
        cp.bmat(
            [
                [bound, error, drift],
                [error.T, own * np.eye(n) - remainder * given["driver"], np.zeros((n, q))],
                [drift.T, np.zeros((q, n)), remainder * np.eye(q)],
            ]
        ),
        cp.bmat([[bound, let_in], [let_in.T, noise]]),
        cp.bmat([[bound, given["Q"]], [given["Q"].T, process]]),
    ]
    return Program(
        {
            "parameters": given | {"weights": weights},
            "gains": gains,
            "bound": bound,
            "inequalities": inequalities,
            "constraints": [own + cp.trace(noise) + cp.trace(process) <= 1.0],
            "cost": weights @ cp.diag(bound),
        }
    )


class Columns:
    """Where what a bounded error is made of stands: 1, e, w, a, and by member b, v, the value, [phi], f."""

    def __init__(self, sizes: Sizes, *, sector: bool) -> None:
        n, block = sizes.states, sizes.members * sizes.outputs
        names = ("remainder", "noise", "value", *(("sector",) if sector else ()), "trigger")
        self.one, self.error, self.process = slice(0, 1), slice(1, 1 + n), slice(1 + n, 1 + 2 * n)
        begin = 1 + 2 * n + sizes.drift
        self.drift = slice(1 + 2 * n, begin)
        self.by_member = {
            name: slice(begin + i * block, begin + (i + 1) * block) for i, name in enumerate(names)
        }
        self.total = begin + len(names) * block

    def of(self, name: str, member: int, outputs: int) -> slice:
        """Return the place of one member's part."""
        begin = self.by_member[name].start + member * outputs
        return slice(begin, begin + outputs)

    def picked(self, *places: slice) -> Matrix:
        """Return the matrix (size, total) that picks places out of all columns."""
        return np.concatenate([np.eye(self.total)[place] for place in places])


def _ball_diagonals(sizes: Sizes, columns: Columns) -> Matrix:
    """Return the diagonal (total, balls) that each ball's multiplier has, with -1 in its first entry.

    Balls: the error, the process noise, by member the noise, by channel the value, by member the trigger.
    """
    M, m = sizes.members, sizes.outputs
    places = [columns.error, columns.process]
    places += [columns.of("noise", j, m) for j in range(M)]
    begin = columns.by_member["value"].start
    places += [slice(begin + s, begin + s + 1) for s in range(M * m)]
    places += [columns.of("trigger", j, m) for j in range(M)]
    diagonals = np.zeros((columns.total, len(places)))
    diagonals[0] = -1.0
    for i, place in enumerate(places):
        diagonals[place, i] = 1.0
    return diagonals


def _remainder_diagonals(sizes: Sizes, columns: Columns) -> Matrix:
    """Return the diagonal (total, 1 + M) of the remainders' multipliers: the plant's, then by member."""
    diagonals = np.zeros((columns.total, 1 + sizes.members))
    diagonals[columns.drift, 0] = 1.0
    for j in range(sizes.members):
        diagonals[columns.of("remainder", j, sizes.outputs), 1 + j] = 1.0
    return diagonals


@lru_cache(maxsize=32)
def bounded_program(sizes: Sizes, *, sector: bool) -> Program:
    """Return the program of the S-procedure over everything that is bounded: sector or moment variant.

    Parameters: ``open`` (n, total) and ``let_in`` (2 m, total), with which the next error is ``(open + gains
    let_in) zeta``; ``driven`` ((1 + n)^2, 1 + M), the squares of what drives each remainder; ``weights``
    (n,). Sector: ``sectors`` (M m, total), the linear forms that each phi lies between zero and. Moment:
    ``residuals`` ((1 + n + 3 m)^2, M m) squares of what each share multiplies, and ``channels`` (2 m, M m).
    """
    cp = _cvxpy()
    n, m, M = sizes.states, sizes.outputs, sizes.members
    columns = Columns(sizes, sector=sector)
    parameters = {
        "open": cp.Parameter((n, columns.total)),
        "let_in": cp.Parameter((2 * m, columns.total)),
        "driven": cp.Parameter(((1 + n) ** 2, 1 + M)),
        "weights": cp.Parameter(n, nonneg=True),
    }
    bound, gains = cp.Variable((n, n), symmetric=True), cp.Variable((n, 2 * m))
    balls = cp.Variable(2 + 2 * M + M * m, nonneg=True)
    remainders, channels = cp.Variable(1 + M, nonneg=True), cp.Variable(M * m, nonneg=True)
    diagonal = np.eye(columns.total)[0] + _ball_diagonals(sizes, columns) @ balls
    diagonal += _remainder_diagonals(sizes, columns) @ remainders
    head = columns.picked(columns.one, columns.error)
    driven = cp.reshape(parameters["driven"] @ remainders, (1 + n, 1 + n), order="C")
    lam = cp.diag(diagonal) - head.T @ driven @ head
    inequalities = []
    if sector:
        lam += _sector_form(cp, parameters, columns, channels)
    else:
        lam -= _residual_form(cp, parameters, columns, sizes, channels)
        inequalities += _share_inequalities(cp, parameters, sizes, bound, gains, channels)
    error = parameters["open"] + gains @ parameters["let_in"]
    return Program(
        {
            "parameters": parameters,
            "gains": gains,
            "bound": bound,
            "inequalities": [cp.bmat([[bound, error], [error.T, lam]]), *inequalities],
            "constraints": [],
            "cost": parameters["weights"] @ cp.diag(bound),
        }
    )


def _sector_form(cp: Any, parameters: dict[str, Any], columns: Columns, channels: Any) -> Any:
    """Return the multipliers' sum (total, total) of ``phi (phi - form)``, and add the forms' parameter."""
    rows = channels.shape[0]
    forms = parameters["sectors"] = cp.Parameter((rows, columns.total))
    picked = columns.picked(columns.by_member["sector"])
    repeated = cp.reshape(channels, (rows, 1), order="C") @ np.ones((1, columns.total))
    crossed = picked.T @ cp.multiply(repeated, forms)
    return cp.diag(picked.T @ channels) - 0.5 * (crossed + crossed.T)


def _residual_form(cp: Any, parameters: dict[str, Any], columns: Columns, sizes: Sizes, channels: Any) -> Any:
    """Return the multipliers' sum (total, total) of squared residuals, and add the residuals' parameter."""
    m = sizes.outputs
    size = 1 + sizes.states + 3 * m
    squares = parameters["residuals"] = cp.Parameter((size**2, sizes.members * m))
    whole: Any = 0.0
    for j in range(sizes.members):
        own = slice(j * m, (j + 1) * m)
        places = [columns.of(name, j, m) for name in ("remainder", "noise", "value")]
        picked = columns.picked(columns.one, columns.error, *places)
        whole += picked.T @ cp.reshape(squares[:, own] @ channels[own], (size, size), order="C") @ picked
    return whole


def _share_inequalities(
    cp: Any, parameters: dict[str, Any], sizes: Sizes, bound: Any, gains: Any, channels: Any
) -> list[Any]:
    """Return, by channel, what bounds the spread that a random share brings, and add its parameter."""
    entries = parameters["channels"] = cp.Parameter((2 * sizes.outputs, sizes.members * sizes.outputs))
    spread = gains @ entries
    found = []
    for s in range(sizes.members * sizes.outputs):
        column = cp.reshape(spread[:, s], (sizes.states, 1), order="C")
        multiplier = cp.reshape(channels[s], (1, 1), order="C")
        found.append(cp.bmat([[bound, column], [column.T, multiplier]]))
    return found
