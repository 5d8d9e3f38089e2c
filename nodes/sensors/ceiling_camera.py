"""A camera at the ceiling that sees where a robot is, and which way it looks (Zhou, Zhang, Wang 2020)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated

import numpy as np
from annotated_types import Gt

from bus.packets import Vector
from nodes.contract import Matrix, Plant
from nodes.gaussian import Gaussian
from nodes.plants.planar_robot import PlanarRobot
from nodes.remainders import LARGEST_ROTATION_REMAINDER, Linearised, drawn_within, rotation_remainder
from nodes.sensors.gaussian_noise import GaussianNoise

FOCAL = (9.0213283, 9.0250141)
"""Focal lengths ``gamma_u``, ``gamma_v`` of the paper (px)."""
HEIGHT_M = 2.105
"""Its distance ``z`` from the ceiling (m)."""
OFFSET_M = (-0.0668, 0.0536)
"""Its offsets ``d_1``, ``d_2`` (m)."""


class CeilingCamera(GaussianNoise):
    """A sensor of a planar robot: where the camera's mark lies in the robot's picture (px).

    With the mark at ``c``, ``r = c - (x, y)`` and ``g = gamma / z``, the two coordinates are ``g_u (-r_x sin
    th + r_y cos th - d_2)`` and ``g_v (-r_x cos th - r_y sin th - d_1)`` plus noise (Zhou, Zhang, Wang 2020,
    (39)-(40)). They are taken relative to the centre ``(p_0, q_0)`` of the picture: an attack that scales
    a packet then acts on the distance from the centre.

    Parameters
    ----------
    plant
        The planar robot.
    position
        Where the mark is (m).
    noise
        Law of the noise (px); its mean must be zero.
    focal
        ``(gamma_u, gamma_v)`` (px); by default those of the paper.
    height
        ``z`` (m).
    offset
        ``(d_1, d_2)`` (m); by default that of the paper.
    noise_bound
        Longest that the noise may be, in its own standard deviations (Mahalanobis length): a longer draw is
        shortened to it. ``R`` and the likelihood are those of the Gaussian law.

    Raises
    ------
    ValueError
        When the plant is no planar robot, or a pair does not have two entries.
    """

    def __init__(
        self,
        plant: Plant,
        *,
        position: list[float],
        noise: Gaussian,
        focal: list[float] | None = None,
        height: Annotated[float, Gt(0.0)] = HEIGHT_M,
        offset: list[float] | None = None,
        noise_bound: Annotated[float, Gt(0.0)] | None = None,
    ) -> None:
        if not isinstance(plant, PlanarRobot):
            raise ValueError(f"{type(plant).__name__} is no planar robot; use the plant 'planar_robot'")
        gammas, offsets = focal or list(FOCAL), offset or list(OFFSET_M)
        for name, pair in (("position", position), ("focal", gammas), ("offset", offsets)):
            if len(pair) != 2:
                raise ValueError(f"{name} has {len(pair)} entries; give two")
        super().__init__(noise, 2)
        self.position: Vector = np.array(position, dtype=np.float64)
        self.scale: Vector = np.array(gammas, dtype=np.float64) / height
        self.offset: Vector = np.array([offsets[1], offsets[0]], dtype=np.float64)
        self._bound = math.inf if noise_bound is None else noise_bound

    @classmethod
    def bank(cls, sensors: Sequence[CeilingCamera]) -> CameraBank:
        """Return several cameras that are linearised at once."""
        return CameraBank(sensors)

    def observe(self, step: int, state: Vector, rng: np.random.Generator, **entering: Vector) -> Vector:
        """Measure (2,) the true state (3,)."""
        noise = self._noise_factor.dot(drawn_within(self._bound, 2, rng))
        values: Vector = self.measure(state[None])[0] + noise
        return values

    def measure(self, states: Matrix, signals: Matrix | None = None) -> Matrix:
        """Return the coordinates (N, 2) for each of N states (N, 3); no signal of an attack enters."""
        pictured: Matrix = self.scale * (_seen(self.position, states)[0] - self.offset)
        return pictured

    def jacobian(self, state: Vector) -> Matrix:
        """Return the derivative (2, 3) of the coordinates at a state (3,)."""
        derivative: Matrix = _slopes(self.scale, *_seen(self.position, state[None]))[0]
        return derivative

    def remainder_bound(self, state: Vector, covariance: Matrix) -> float:
        """Return ``V`` with ``|h(x) - h(x^) - H e| <= V |e_th|`` for every e in ``e' P^-1 e <= 1``.

        ``V = max(g) (c |r| + d)``, where the heading errs by at most a and ``c`` is the remainder of a
        rotation up to it, and the position by at most d.
        """
        angle = math.sqrt(max(covariance[2, 2], 0.0))
        half, middle = (
            0.5 * (covariance[0, 0] - covariance[1, 1]),
            0.5 * (covariance[0, 0] + covariance[1, 1]),
        )
        radius = math.sqrt(middle + math.hypot(half, covariance[0, 1]))
        distance = math.dist(self.position, state[:2])
        return float(self.scale.max()) * (rotation_remainder(angle) * distance + radius)


class CameraBank:
    """Several cameras that are linearised at once, each at an estimate of its own."""

    def __init__(self, cameras: Sequence[CeilingCamera]) -> None:
        self._cameras = list(cameras)
        self._stacked = lru_cache(maxsize=64)(self._stack)

    def _stack(self, which: tuple[int, ...]) -> tuple[Matrix, Matrix, Matrix, Vector]:
        """Return positions, scales and offsets (M, 2), and the larger scales (M,), of some cameras."""
        chosen = [self._cameras[i] for i in which]
        position, scale, offset = (
            np.array([getattr(camera, name) for camera in chosen]) for name in ("position", "scale", "offset")
        )
        return position, scale, offset, scale.max(axis=1)

    def linearised(self, which: tuple[int, ...], states: Matrix, covariances: np.ndarray) -> Linearised:
        """Linearise some of the cameras, each at its estimate (M, 3) with covariance (M, 3, 3)."""
        position, scale, offset, largest = self._stacked(which)
        seen, sine, cosine = _seen(position, states)
        along_x, across, along_y = covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1]
        radius = np.sqrt(0.5 * (along_x + along_y + np.hypot(along_x - along_y, across + across)))
        turned = np.minimum(0.5 * np.sqrt(covariances[:, 2, 2]), LARGEST_ROTATION_REMAINDER)
        remainders = largest * (turned * np.hypot(seen[:, 0], seen[:, 1]) + radius)
        return Linearised(scale * (seen - offset), _slopes(scale, seen, sine, cosine), remainders)


def _seen(position: np.ndarray, states: Matrix) -> tuple[Matrix, Vector, Vector]:
    """Return where marks are in the robot's frame (N, 2): to its left, and behind it (m).

    Then sine and cosine (N,) of its heading.
    """
    reach = position - states[:, :2]
    sine, cosine = np.sin(states[:, 2]), np.cos(states[:, 2])
    seen: Matrix = np.empty((len(states), 2))
    ahead, aside = reach[:, 0], reach[:, 1]
    seen[:, 0] = aside * cosine - ahead * sine
    seen[:, 1] = -ahead * cosine - aside * sine
    return seen, sine, cosine


def _slopes(scale: np.ndarray, seen: Matrix, sine: Vector, cosine: Vector) -> np.ndarray:
    """Return the derivatives (N, 2, 3) of the coordinates in the picture.

    By the heading, what lies to the left moves back and what lies behind moves to the left.
    """
    slopes = np.empty((len(seen), 2, 3))
    slopes[:, 0, 0] = slopes[:, 1, 1] = sine
    slopes[:, 1, 0] = cosine
    slopes[:, 0, 1] = -cosine
    slopes[:, 0, 2] = seen[:, 1]
    slopes[:, 1, 2] = -seen[:, 0]
    slopes *= scale[..., None]
    return slopes
