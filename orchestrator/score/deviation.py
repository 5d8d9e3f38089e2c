"""How far estimators are from a reference among them, such as the same filter that nobody attacks."""

from __future__ import annotations

import numpy as np

from bus.plan import Plan
from orchestrator.score.accuracy import Errors
from orchestrator.score.gather import Bools, Estimates, ScoreError
from orchestrator.score.results import Deviation


def deviations(
    plan: Plan, estimates: Estimates, errors: Errors, counted: Bools, reference: str
) -> list[Deviation | None]:
    """Return each estimator's deviation from the reference over the steps in ``counted`` (K,).

    None for the reference itself, without a reference, for an estimator that diverged (or when the reference
    did), and where no step has an estimate of both. Errors are compared: the same as comparing estimates
    where both refer to one step. Raises ScoreError when there is no such estimator.
    """
    names = [estimator.name for estimator in plan.estimators]
    if not reference:
        return [None] * len(names)
    if reference not in names:
        raise ScoreError(f"the reference '{reference}' is no estimator of the run; name one of {names}")
    other = names.index(reference)
    found: list[Deviation | None] = []
    for i in range(len(names)):
        difference = (estimates.error[i] - estimates.error[other])[counted]
        difference = difference[~np.isnan(difference).any(axis=1)]
        if i == other or max(errors.divergence_step[[i, other]]) >= 0 or not difference.size:
            found.append(None)
            continue
        total = float(np.sqrt(np.square(difference).sum()))
        found.append(
            Deviation(
                reference=reference,
                component_rms=total / difference.size**0.5,
                norm_over_steps=total / len(difference),
            )
        )
    return found
