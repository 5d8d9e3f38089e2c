"""Particles that no measurement weighs: a baseline of Sadeghzadeh-Nokhodberiz et al. 2022."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from annotated_types import Ge

from bus.packets import Packet
from nodes.contract import Setting
from nodes.estimators.particle import Particle


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

    def _weigh(self, packets: Sequence[Packet]) -> None:
        """Leave the weights alone."""
