"""Joint input and state estimation under a signal of which nothing is known (Gillijns, De Moor 2007)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Belief, Setting
from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.hybrid_density import (
    Density,
    Reduction,
    Switching,
    sensor_under_attack,
    settle,
)
from nodes.estimators.hybrid_filter import HybridFilter, signal_diagnostics
from nodes.estimators.joint_input_state import joseph, unknown_signal
from nodes.estimators.packet_sets import packet_sets, pooled

_ALWAYS = Switching(1.0, 1.0)
_ALL = Reduction(0.0, 0.0, 1)


class Jise(HybridFilter):
    """The unbiased minimum-variance filter of state and unknown signal, always under attack.

    It takes the signal as unknown in every step, with feedthrough (``y = C x + H a + v``; Automatica 43(5))
    or without (``a`` shows in the next step; Automatica 43(1)). It knows of no fakes: every packet of a
    sensor is a measurement. A direction of the signal that no packet of a step shows is taken from
    ``attack_prior``.

    Parameters
    ----------
    setting
        Linear models.
    attack_prior
        Law of the signal where nothing shows it, and only there.
    feedthrough
        Whether the signal of a step shows in that step's measurements.

    Raises
    ------
    ValueError
        When a model is not linear, or some direction of the signal shows in no measurement.
    """

    def __init__(self, setting: Setting, *, attack_prior: AttackLaw, feedthrough: bool = True) -> None:
        super().__init__(
            setting,
            [attack_prior],
            feedthrough=feedthrough,
            switching=_ALWAYS,
            initial_attack_probability=1.0,
        )
        self._nis = 0.0
        self._nis_dof = 0

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict from the step before, then correct by this step's packets; nothing is sent."""
        if step > 0:
            self._density = self._predicted(step)
        self._nis, self._nis_dof = 0.0, 0
        for source, members in packet_sets(step, packets, self._sizes).items():
            self._take(source, members)
        self._density = settle(self._density, _ALL)
        return None

    def estimate(self, step: int) -> Belief:
        """Return the state and, as diagnostics, the signal ``a0``, ... with ``a0_sigma``, ....

        NIS is of what the signal cannot explain. The signal is that of ``attack_step``.
        """
        n = self._model.n
        safe, attacked = self._density
        state, covariance = (attacked if attacked.size else safe)[1:3]
        return Belief(
            state[0, :n].copy(),
            covariance[0, :n, :n].copy(),
            nis=self._nis,
            nis_dof=self._nis_dof,
            diagnostics={
                "attack_step": self._attack_step(step),
                **signal_diagnostics(*self._only_signal()),
            },
        )

    def _take(self, source: str, members: Sequence[Packet]) -> None:
        """Correct by the measurements of one sensor."""
        sensor, safe, attacked = self._model.sensors[source], *self._density
        measured = pooled(members, sensor.noise)
        under_attack = attacked.size > 0
        part = attacked if under_attack else safe
        if under_attack:
            linear = sensor_under_attack(part, sensor, self._model.n)
        else:
            linear = sensor.plain(part.means, part.covariances)
        free = part.free if part.free is not None else np.zeros((1, 0, 0))
        found = unknown_signal(part.covariances, linear.slope, measured.noise, free)
        innovation = measured.values - linear.value[0]
        self._nis += float(innovation.dot(found.whitening[0]).dot(innovation)) + measured.scatter
        fixed = round(float(np.trace((free - found.free)[0])))
        self._nis_dof += innovation.size + measured.scatter_dof - fixed
        corrected = part._replace(
            means=part.means + found.gain[0].dot(innovation),
            covariances=joseph(part.covariances, found.gain, linear.slope, measured.noise),
            free=found.free if under_attack else None,
        )
        self._density = Density(safe, corrected) if under_attack else Density(corrected, attacked)
