"""Particles that no measurement weighs: a baseline of Sadeghzadeh-Nokhodberiz et al. 2022."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from annotated_types import Ge

from bus.packets import Packet, Vector
from nodes.contract import Matrix, Setting
from nodes.estimators.particle import Particle
from nodes.estimators.particle_moments import Moments


class ParticleUnweighted(Particle):
    """A particle filter in which every likelihood is 1: it predicts from the initial law and never corrects.

    It is what Sadeghzadeh-Nokhodberiz 2022, section V-B makes of the secure particle filter of Song et al.
    2021 (their reference 31), which was made for binary sensors. No attack can move it, and no measurement
    either.

    Parameters
    ----------
    setting
        A plant that can be sampled, and sensors with a likelihood.
    particles
        Number ``N`` of particles.
    """

    def __init__(self, setting: Setting, *, particles: Annotated[int, Ge(2)] = 1000) -> None:
        super().__init__(setting, particles=particles, resampling="none")

    def _log_likelihood(self, packet: Packet, predicted: Matrix, own: Moments) -> Vector:
        """Return that every likelihood is 1."""
        return np.zeros(len(predicted))
