"""Noise that an adversary adds to what packets say."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from bus.packets import Vector
from channel.attacks.falsifying import FalsifyingLane, Part
from channel.attacks.laws import Deviation
from channel.contract import Lane, Placement, Slot
from channel.draws import SteppedVectors


class Noise:
    """Adds white Gaussian noise with mean zero to the payload, a draw for each slot.

    Parameters
    ----------
    std
        Standard deviation, in the payload's unit: one number, or one for each attacked component.
    covariance
        Instead of ``std``: the positive definite covariance over the attacked components.
    components
        The indices of the payload that are attacked; all of them when not given.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        std: Deviation | list[Deviation] | None = None,
        covariance: list[list[float]] | None = None,
        components: list[int] | None = None,
    ) -> None:
        self._placement = placement
        if std is not None and covariance is None:
            self._part = Part(components, std=std)
            self._std = np.asarray(std, dtype=np.float64)
            self._factor = None
            if np.any(self._std < 0.0):
                raise ValueError(f"'std' {std} must not be negative")
        elif covariance is not None and std is None:
            self._part = Part(components, covariance=[0.0] * len(covariance))
            self._std = np.ones(())
            self._factor = _factor(covariance)
        else:
            raise ValueError("give exactly one of 'std' and 'covariance'")
        self._draws = placement.by_link(
            lambda generator: SteppedVectors(generator, np.random.Generator.standard_normal)
        )

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _NoiseLane(self._placement, link, self._part, self._draws[link], self._std, self._factor)


def _factor(covariance: list[list[float]]) -> np.ndarray:
    """Return the lower Cholesky factor; raises ValueError for what is no positive definite covariance."""
    size = len(covariance)
    if any(len(row) != size for row in covariance):
        raise ValueError(f"'covariance' must be square, here: {[len(row) for row in covariance]} a row")
    matrix = np.array(covariance, dtype=np.float64)
    if not np.allclose(matrix, matrix.T):
        raise ValueError("'covariance' must be symmetric")
    try:
        return np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError as error:
        raise ValueError(
            "'covariance' must be positive definite; leave out components without noise"
        ) from error


class _NoiseLane(FalsifyingLane):
    cure = "give one 'std', or 'std' or 'covariance' for each of its 'components'"

    def __init__(
        self,
        placement: Placement,
        link: str,
        part: Part,
        draws: SteppedVectors,
        std: Vector,
        factor: np.ndarray | None,
    ) -> None:
        super().__init__(placement, link, part)
        self._draw = draws.at
        self._std = std
        self._factor = factor

    def false(self, slot: Slot, values: Vector) -> Vector:
        draw = self._draw(slot.number, values.size)
        return values + (self._std * draw if self._factor is None else self._factor.dot(draw))
