"""Whether the estimators of some rows are consistent: NEES, NIS and whiteness, with and without attack.

Estimators of one trial follow one plant and may hear one another, so what is put together of them is
independent between trials only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, Literal, TypeVar

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.columns import Rows
from orchestrator.evidence.consistency import Overall, overall_by_trial, overall_independent
from orchestrator.evidence.whiteness import Whiteness, standardised_nis, whiteness
from orchestrator.score.gather import Bools, Floats, Ints

T = TypeVar("T")
ChiSquare = Literal["nees", "nis"]


@dataclass(frozen=True)
class Split(Generic[T]):
    """A figure over all steps, over those in which an attack reached the estimator, and over the others."""

    all: T
    attacked: T
    unattacked: T

    @staticmethod
    def of(figure: Callable[[Bools], T], counted: Bools, attacked: Bools) -> Split[T]:
        """Return a figure of each choice of steps, given which count and which were attacked."""
        return Split(*(figure(where) for where in (counted, counted & attacked, counted & ~attacked)))


@dataclass(frozen=True)
class LeastWhite:
    """The whiteness of that estimator which contradicts it most; ``node`` is empty without any.

    Its ``p_value`` is that of the least among so many (Bonferroni). ``from_nis`` says that it had to be
    judged by its NIS, for want of innovations.
    """

    node: str
    found: Whiteness
    from_nis: bool


@dataclass(frozen=True)
class Consistency:
    """NEES, NIS and whiteness over all steps, split by attack.

    ``diverged`` of the ``trials`` that have a score count only up to the divergence of an estimator, and
    ``undefined`` is the share of estimates whose covariance is no covariance, so that they have no NEES.
    Where either is not 0, the figures are of what is left, which is better than the whole.
    """

    nees: Split[Overall]
    nis: Split[Overall]
    whiteness: Split[LeastWhite]
    trials: int
    diverged: int
    undefined: float


def chi_square_figures(rows: Rows, what: ChiSquare) -> tuple[Floats, Ints]:
    """Return NEES or NIS (R, K) of rows with their degrees of freedom; 0 where there is no figure."""
    figures = rows.series(what)
    if what == "nis":
        return figures, np.nan_to_num(rows.series("nis_dof")).astype(np.int64)
    size = np.broadcast_to(rows.scalar("state_size").astype(np.int64)[:, None], figures.shape)
    return figures, np.where(np.isfinite(figures), size, 0)


def consistency(rows: Rows, from_step: int = 0, confidence: float = CONFIDENCE) -> Consistency:
    """Return whether covariances and innovations are as they should be, from a step on.

    NIS of one estimator a trial is independent over steps and judged by exact bounds; of several, as NEES
    always, by how far trials differ. Whiteness is tested for each estimator, and the worst is told.
    """
    attacked = rows.series("attacked") == 1.0
    counted = rows.alive & (np.arange(rows.steps) >= from_step)
    (nees, nees_dof), (nis, nis_dof) = chi_square_figures(rows, "nees"), chi_square_figures(rows, "nis")
    shares_trials = np.unique(rows.trial).size < rows.trial.size

    def by_trial(figures: Floats, dof: Ints, where: Bools) -> Overall:
        return overall_by_trial(figures, dof, where, confidence, rows.trial)

    def nis_in(where: Bools) -> Overall:
        if shares_trials:
            return by_trial(nis, nis_dof, where)
        return overall_independent(nis, nis_dof, where, confidence)

    innovation = rows.by_step("innovation", rows.steps)
    instead = standardised_nis(nis, nis_dof)
    estimated = counted & np.isfinite(rows.series("error.state"))
    diverged = np.unique(rows.trial[np.isfinite(rows.scalar("divergence_step"))]).size
    return Consistency(
        Split.of(lambda where: by_trial(nees, nees_dof, where), counted, attacked),
        Split.of(nis_in, counted, attacked),
        Split.of(lambda where: _least_white(rows, innovation, instead, where), counted, attacked),
        int(np.sum(~rows.failed)),
        diverged,
        float(np.sum(estimated & ~np.isfinite(nees)) / max(1, estimated.sum())),
    )


def _least_white(rows: Rows, innovation: Floats, instead: Floats, counted: Bools) -> LeastWhite:
    """Return the worst of the whiteness of each estimator, of innovations (R, K, M) or else NIS (R, K, 1)."""
    node = np.array(rows.text("node"), dtype=object)
    found = []
    for name in dict.fromkeys(node):
        own = node == name
        from_nis = not np.isfinite(innovation[own]).any()
        tested = whiteness((instead if from_nis else innovation)[own], counted[own])
        if not np.isnan(tested.p_value):
            found.append((name, tested, from_nis))
    if not found:
        return LeastWhite("", whiteness(np.empty((0, 0, 1))), from_nis=False)
    name, tested, from_nis = min(found, key=lambda each: each[1].p_value)
    return LeastWhite(name, replace(tested, p_value=min(1.0, len(found) * tested.p_value)), from_nis)
