"""What an adversary may be granted to know of the plant and its filters, as plain matrices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nodes.contract import ControlledPlant, LinearPlant, LinearSensor, Matrix, Plant, Sensor


class KnowledgeError(ValueError):
    """What was granted cannot be computed for this plant; the text says why and what to do."""


def knowledge(
    plant: Plant,
    sensors: Mapping[str, Sensor],
    listens: Mapping[str, Sequence[str]],
    granted: frozenset[str],
) -> dict[str, Any]:
    """Return what the grants ``model`` and ``innovations`` tell, as nested lists by name.

    ``A``, ``B``, ``Q`` and ``sensors`` with ``C`` and ``R`` of each; and with ``innovations``, for each
    estimator that listens to sensors, in ``estimators``: those ``sensors`` in order, and of its steady-state
    Kalman filter the filtering gain ``K`` (n, m), the innovation covariance ``S`` (m, m), and the covariances
    ``P_prior`` and ``P_posterior`` (n, n). Raises KnowledgeError.
    """
    if not granted & {"model", "innovations"}:
        return {}
    if not isinstance(plant, LinearPlant) or not all(
        isinstance(own, LinearSensor) for own in sensors.values()
    ):
        raise KnowledgeError("'model' and 'innovations' are matrices: they need a linear plant and sensors")
    models = {name: own for name, own in sensors.items() if isinstance(own, LinearSensor)}
    found: dict[str, Any] = {}
    if "model" in granted:
        B = plant.B if isinstance(plant, ControlledPlant) else np.zeros((len(plant.A), 0))
        found |= {"A": plant.A.tolist(), "B": B.tolist(), "Q": plant.Q.tolist()}
        found["sensors"] = {name: {"C": own.C.tolist(), "R": own.R.tolist()} for name, own in models.items()}
    if "innovations" in granted:
        found["estimators"] = {
            name: {"sensors": list(heard), **_steady_state(plant, [models[sensor] for sensor in heard], name)}
            for name, heard in listens.items()
            if heard
        }
    return found


def _steady_state(plant: LinearPlant, sensors: Sequence[LinearSensor], name: str) -> dict[str, Any]:
    """Return the steady state of the Kalman filter on some sensors."""
    from scipy.linalg import block_diag, cho_factor, cho_solve, solve_discrete_are

    C: Matrix = np.concatenate([sensor.C for sensor in sensors])
    R = block_diag(*(sensor.R for sensor in sensors))
    try:
        prior = solve_discrete_are(plant.A.T, C.T, plant.Q, R)
        S = C @ prior @ C.T + R
        K = cho_solve(cho_factor(S, lower=True), C @ prior).T
    except (np.linalg.LinAlgError, ValueError) as error:
        raise KnowledgeError(
            f"'innovations': the Kalman filter of {name} has no steady state ({error}); see that its sensors "
            "detect every unstable mode"
        ) from error
    posterior = prior - K @ C @ prior
    return {
        "K": K.tolist(),
        "S": S.tolist(),
        "P_prior": prior.tolist(),
        "P_posterior": (0.5 * (posterior + posterior.T)).tolist(),
    }
