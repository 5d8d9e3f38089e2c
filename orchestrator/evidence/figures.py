"""What the rows of one variant show of its estimators: errors, agreement, communication.

Several estimators of one trial are pooled inside the trial; the trials are what intervals are taken over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE, Band, bootstrap, pooled
from orchestrator.evidence.columns import Rows
from orchestrator.evidence.intervals import Interval, only, share
from orchestrator.score.gather import Floats


def _pooled(rows: Rows, above: Floats, below: Floats, confidence: float, *, root: bool = True) -> Band:
    """Return the (root of the) ratio of sums over trials, of (R, K) each; NaN in either counts in neither."""
    known = ~(np.isnan(above) | np.isnan(below))
    numerator, denominator = (rows.by_trial(np.where(known, part, 0.0)) for part in (above, below))
    statistic = pooled(numerator, denominator, np.sqrt if root else None)
    return bootstrap(statistic, rows.trials, confidence=confidence)


def rmse_curve(rows: Rows, group: str, confidence: float = CONFIDENCE) -> Band:
    """Return the RMSE of a state group at each step, over the trials in which it has not diverged by then."""
    error = np.where(rows.alive, rows.series(f"error.{group}"), np.nan)
    return _pooled(rows, error**2, np.ones_like(error), confidence)


def mean_curve(rows: Rows, name: str, *, root: bool = False, confidence: float = CONFIDENCE) -> Band:
    """Return the mean of a list column at each step, or the root mean square, over trials that have it."""
    values = rows.series(name)
    values = np.pad(values, ((0, 0), (0, rows.steps - values.shape[1])), constant_values=np.nan)
    return _pooled(rows, values**2 if root else values, np.ones_like(values), confidence, root=root)


def rmse(rows: Rows, group: str, confidence: float = CONFIDENCE) -> Interval:
    """Return the RMSE of a state group over the scored steps of all trials in which it did not diverge.

    Look at `divergences` beside it: those have no finite error.
    """
    error = rows.scalar(f"rmse.{group}")[:, None]
    error = np.where(np.isinf(error), np.nan, error)
    return only(_pooled(rows, error**2, np.ones_like(error), confidence))


def divergences(rows: Rows, confidence: float = CONFIDENCE) -> Interval:
    """Return the share of the scored trials in which any of the estimators diverged, by Wilson's interval."""
    diverged = rows.by_trial((~np.isnan(rows.scalar("divergence_step"))).astype(np.float64)) > 0
    return share(int(diverged.sum()), int(np.sum(~rows.failed)), confidence)


@dataclass(frozen=True)
class Efficiency:
    """Errors beside the bound that nobody beats: ``ratio`` is 1 for an estimator that meets it.

    ``bound`` is the root mean square over trials of the bounds given what each lost, and ``ratio`` that of
    the errors over it, in the steps in which the bound is right: ``steps`` of all. ``refused`` tells why it
    is missing elsewhere, by its number of rows, and ``given`` whose packets it supposes.
    """

    bound: Band
    ratio: Interval
    steps: float
    refused: dict[str, int]
    given: tuple[str, ...]


def efficiency(rows: Rows, group: str, from_step: int = 0, confidence: float = CONFIDENCE) -> Efficiency:
    """Return how close the errors of a state group come to the posterior Cramer-Rao bound."""
    bound = rows.series(f"pcrb.{group}")
    error = np.where(rows.alive, rows.series(f"error.{group}"), np.nan)
    bound = np.where(np.isnan(error), np.nan, bound)
    late = np.arange(rows.steps) >= from_step
    known = ~np.isnan(bound) & late
    above, below = (np.where(known, part**2, 0.0).sum(axis=1)[:, None] for part in (error, bound))
    reasons = [reason for reason in rows.text("pcrb.refused") if reason]
    return Efficiency(
        _pooled(rows, bound**2, np.ones_like(bound), confidence),
        only(_pooled(rows, above, below, confidence)),
        float(known.sum() / max(1, late.sum() * len(known))),
        {reason: reasons.count(reason) for reason in sorted(set(reasons))},
        tuple(sorted({given for given in rows.text("pcrb.given") if given})),
    )


def disagreement_curve(rows: Rows, confidence: float = CONFIDENCE) -> Band:
    """Return the RMS distance of estimates from their network's mean at each step, over trials."""
    apart = rows.series("disagreement_by_step")
    return _pooled(rows, apart**2, np.ones_like(apart), confidence)


def sent_rate(rows: Rows, confidence: float = CONFIDENCE) -> Interval:
    """Return the share of slots that held a packet, among those of the estimators and of their sensors."""
    sent, slots = rows.series("sent").sum(axis=1), rows.scalar("slots") * rows.steps
    return only(_pooled(rows, sent[:, None], slots[:, None], confidence, root=False))
