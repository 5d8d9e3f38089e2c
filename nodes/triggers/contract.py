"""What an event trigger is told, and what its silence tells a receiver that knows it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix, Plant, Sensor, Trigger


@dataclass(frozen=True)
class TriggerSetting:
    """What an event trigger is told of the world: models, never states."""

    name: str
    """The sender's node name."""
    plant: Plant
    sensor: Sensor | None
    """The sender's own model; None for an estimator."""
    rng: np.random.Generator
    """The sender's stream for this purpose."""


class GaussianSilence(NamedTuple):
    """Silence has the likelihood ``exp(-(y - c)' Y (y - c) / 2)`` given the value ``y`` (m,).

    It tells as much as a measurement of the value ``centre`` c (m,) whose noise has ``covariance`` Y^-1 (m,
    m) more.
    """

    centre: Vector
    covariance: Matrix


class BoxSilence(NamedTuple):
    """Silence says that no component of ``L^-1 (y - c)`` exceeds ``half_width`` in magnitude.

    ``centre`` is c (m,), ``factor`` the lower triangular L (m, m).
    """

    centre: Vector
    factor: Matrix
    half_width: float


Silence = GaussianSilence | BoxSilence


@runtime_checkable
class InformativeTrigger(Trigger, Protocol):
    """A trigger whose silence says something to a receiver that runs a copy of it.

    In every step a receiver asks its copy for `silence` and then tells it with `note` what came. The copy
    stays that of the sender as long as nothing is lost on the way.
    """

    def silence(self, step: int) -> Silence | None:
        """Return what a quiet slot in ``step`` tells of the value; None for nothing."""
        ...

    def note(self, step: int, values: Vector | None) -> None:
        """Take what was sent in ``step`` (m,), None for a quiet slot."""
        ...
