"""The Kalman filter that learns from silence: it knows the event triggers of its sensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from bus.packets import Packet, Vector
from nodes.contract import Belief, Setting
from nodes.estimators.commanded_input import Commanded, CommandedInput
from nodes.estimators.linear_gaussian import Dynamics, SensorBank, correct
from nodes.estimators.solitary import SolitaryGaussian
from nodes.triggers.contract import InformativeTrigger
from nodes.triggers.silence import learn


class EventTriggeredKalman(Commanded, SolitaryGaussian):
    """A Kalman filter for sensors with event triggers, without neighbours.

    Packets are taken as by `Kalman`. A sensor that was silent tells something as well, if its trigger is one
    that says what: the filter runs a copy of the trigger and corrects by its `silence`. With triggers
    ``stochastic_innovation`` the state stays Gaussian and the filter is optimal (Han, Mo, Wu, Weerakkody,
    Sinopoli, Shi 2015); with ``deterministic_innovation`` it takes the Gaussian of the same moments (Wu,
    Jia, Johansson, Shi 2013), and so for ``send_on_delta``, whose silence is a box around the last value.

    A lost packet looks like silence. Where links lose packets and ``silence`` is ``informative``, the filter
    believes what nobody said and its copy parts from the sender's trigger: its covariance is then too small.
    With ``ignored`` it is the plain Kalman filter.

    The innovations of what was sent are chosen for their size, so the mean NIS is above its degrees of
    freedom even where the filter is optimal; the NEES is what judges it.

    Parameters
    ----------
    setting
        The node's models: a linear plant, and linear sensors whose noise is not singular.
    silence
        Whether a quiet slot counts as ``informative``.

    Raises
    ------
    ValueError
        When the plant or a sensor is not linear, or a sensor's noise is singular.
    """

    def __init__(
        self, setting: Setting, *, silence: Literal["informative", "ignored"] = "informative"
    ) -> None:
        self._dynamics = Dynamics(setting)
        self._sensors = SensorBank(setting)
        super().__init__(setting)
        self._input = CommandedInput(setting.plant)
        self._triggers: dict[str, InformativeTrigger] = {}
        if silence == "informative":
            for name, trigger in setting.sensor_triggers.items():
                if isinstance(trigger, InformativeTrigger):
                    self._triggers[name] = trigger
        self._silent = 0

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict, correct by what was sent and then by the silences, in the sensors' order."""
        if step > 0:
            self._state = self._input.add_to(self._dynamics.A.dot(self._state))
            self._covariance = self._dynamics.propagate(self._covariance)
        self._nis, self._nis_dof = 0.0, 0
        current = self._sensors.measurements(step, packets)
        if current:
            model, values = self._sensors.stack(current)
            correction = correct(self._state, self._covariance, model, values)
            self._state, self._covariance = correction.state, correction.covariance
            self._nis, self._nis_dof = correction.nis, len(values)
        self._listen(step, {packet.source: packet.values for packet in current})
        return None

    def _listen(self, step: int, arrived: dict[str, Vector]) -> None:
        """Learn from the sensors that were silent, and let the copies of their triggers take the step."""
        self._silent = 0
        for name, trigger in self._triggers.items():
            values = arrived.get(name)
            told = trigger.silence(step) if values is None else None
            if told is not None:
                model = self._sensors.models[name]
                self._state, self._covariance = learn(self._state, self._covariance, model, told)
                self._silent += 1
            trigger.note(step, values)

    def estimate(self, step: int) -> Belief:
        """Return the filtered state and its error covariance.

        Diagnostics: ``silent`` counts the sensors from whose silence it learnt in this step.
        """
        return Belief(
            self._state,
            self._covariance,
            nis=self._nis,
            nis_dof=self._nis_dof,
            diagnostics={"silent": float(self._silent)},
        )
