"""Event-triggered distributed extended Kalman filtering under deception (Zhou, Zhang, Wang 2020)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Belief, Listens, Matrix, NonlinearPlant, NonlinearSensor, Setting
from nodes.estimators.arrivals import measurements
from nodes.estimators.dead_reckoning import start
from nodes.estimators.gain_knowledge import Deception, Design, Local, Shares, stacked
from nodes.estimators.gain_lmi import Lmi, LmiVariant
from nodes.estimators.gain_riccati import Riccati, RiccatiVariant
from nodes.estimators.innovation_exchange import QUIET, SENT, UNMEASURED, Heard, Layout, Memory
from nodes.estimators.nonlinear_gaussian import nonlinear_plant, nonlinear_sensors
from nodes.gaussian import Gaussian
from nodes.remainders import BoundedPlant, bank_of
from nodes.triggers.relative import Relative

_NO_ERROR = Gaussian(std=0.0)


@dataclass(frozen=True)
class GainDesign:
    """How the gains are chosen: exactly one of two families, and its variant.

    Parameters
    ----------
    riccati
        In closed form: ``nominal``, ``adversarial`` or ``residual`` (`nodes.estimators.gain_riccati`).
    lmi
        By a semidefinite program in each step: ``nominal``, ``moment`` or ``sector``
        (`nodes.estimators.gain_lmi`). It needs the extra ``lmi``.
    """

    riccati: RiccatiVariant | None = None
    lmi: LmiVariant | None = None

    def __post_init__(self) -> None:
        """Refuse what is no choice; raises ValueError."""
        if (self.riccati is None) == (self.lmi is None):
            raise ValueError("give exactly one of 'riccati' and 'lmi'")


_RICCATI = GainDesign(riccati="nominal")


class EventTriggeredExtendedKalman:
    """A distributed extended Kalman predictor whose nodes exchange innovations when they differ.

    Each node compares its measurement, which may be falsified, with its own prediction: ``z_i = y~_i -
    h_i(x^_i)`` (6). Its event trigger decides on sending it; that of the paper is ``relative``, and compares
    with ``Psi_i = sum_j (z_j^s - z_i^s)`` of the innovations that were last sent (8). Without a trigger each
    is sent. Then ``x^_i+ = f(x^_i) + K_i z_i^s + C_i Psi_i`` (9). A slot carries ``x^_i``, its bound ``P_i``,
    whether ``z_i`` was sent, and either ``z_i`` or the bound of what was not said: ``sigma Psi_i' Phi
    Psi_i``, or with another trigger ``|z_i - z_i^s|^2`` itself. The estimate that is published in step k
    refers to k + 1.

    The gains come from a design of the node's own; see docs/zhou2020.md for which of their bounds hold. The
    published covariance is ``P`` of a design that bounds the second moment, and ``P / n`` of one that bounds
    the error by an ellipsoid ``e' P^-1 e <= 1``: in both cases an error outside its bound has a NEES above n.

    A lost measurement, and lost packets of neighbours, leave out what can no longer be known: see
    `nodes.estimators.innovation_exchange`.

    Parameters
    ----------
    setting
        A plant with a transition and its Jacobian, exactly one sensor of the same sort, and neighbours that
        have one each, all with as many outputs. Plant and sensors that bound the remainder of their
        linearisation (`nodes.remainders`) are believed; others are taken as linear. The neighbours' triggers
        are taken to be the node's own.
    assumed_attack
        What the design assumes of the attack on measurements; none when not given.
    design
        How the gains are chosen.
    process_noise
        Law of the process noise that the design assumes, by default the plant's own.
    initial
        Law of the initial error that the design assumes (its mean does not count), by default the plant's own
        with ``start_error`` added.
    start_error
        Law of an error that the node adds to the plant's initial mean, drawn for itself; none by default.
    size_weights
        How much each state component counts in the size of the bound that ``lmi`` makes small; 1 by default.

    Raises
    ------
    ValueError
        When the setting or a parameter is not as described, or the extra that ``lmi`` needs is missing.
    """

    listens: ClassVar[Listens] = "paired"
    knows_neighbours_sensors: ClassVar[bool] = True
    takes_trigger: ClassVar[bool] = True
    rounds = 1

    def __init__(
        self,
        setting: Setting,
        *,
        assumed_attack: Deception | None = None,
        design: GainDesign = _RICCATI,
        process_noise: Gaussian | None = None,
        initial: Gaussian | None = None,
        start_error: Gaussian = _NO_ERROR,
        size_weights: list[float] | None = None,
    ) -> None:
        self._plant = nonlinear_plant(setting)
        sensors = _sensors(setting)
        self._source, self._sensor = next(iter(setting.sensors)), sensors[0]
        n, self._m = len(setting.plant.initial_mean), len(self._sensor.R)
        self._bank = bank_of(sensors)
        self._noise_of = lru_cache(maxsize=64)(lambda which: np.array([sensors[i].R for i in which]))
        self._place = {name: 1 + i for i, name in enumerate(sorted(setting.neighbours))}
        self._linearisation = _Linearisation(self._plant)
        Q = self._plant.Q if process_noise is None else process_noise.covariance_matrix(n)
        shares = Shares.of(assumed_attack, self._m)
        weights = _size_weights(size_weights, n)
        self._design = _design(design, shares, Q, len(sensors), weights)
        self._layout = Layout(n, self._m)
        self._memory = Memory(self._layout, setting.neighbours)
        self._trigger = setting.trigger
        self._relative = setting.trigger if isinstance(setting.trigger, Relative) else None
        Phi = np.eye(self._m) if self._relative is None else self._relative.weight(self._m)
        self._unsaid: Matrix = np.asarray(np.linalg.inv(Phi), dtype=np.float64)
        self._state, added = start(setting, start_error)
        prior = setting.plant.initial_covariance + added if initial is None else initial.covariance_matrix(n)
        if np.linalg.eigvalsh(prior)[0] <= 0.0:
            raise ValueError(f"{setting.name}: the initial law is singular; give 'initial' a positive std")
        self._bound: Matrix = prior
        self._last: Vector = np.zeros(self._m)
        self._slack = 0.0
        self._heard = 0
        self._payload = np.zeros(self._layout.quiet)
        self._measured = self._sent = False

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Take the innovation of this step's measurement, and decide on sending it."""
        current = measurements(step, packets, {self._source: self._m})
        self._measured, self._sent, self._slack = bool(current), False, 0.0
        if not current:
            return self._told(UNMEASURED, None)
        innovation = current[-1].values - self._sensor.measure(self._state[None])[0]
        disagreement = self._disagreement()
        self._sent = self._trigger is None or self._trigger.sends(step, innovation, disagreement)
        if self._sent:
            self._last = innovation
            return self._told(SENT, innovation)
        self._slack = self._unheard(innovation, disagreement)
        return self._told(QUIET, None)

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Choose the gains, and predict the next state by innovations of the node and its neighbours."""
        heard = self._memory.take(step, self._payload, self._last, packets)
        self._heard = len(heard.names)
        local = self._local(heard)
        gains = self._design.gains(local)
        moved = self._plant.transition(heard.states[:1])[0]
        self._state = moved + gains.matrix.dot(stacked(heard.innovations, local))
        self._bound = gains.bound
        return None

    def estimate(self, step: int) -> Belief:
        """Return the prediction of the next state, with its bound as covariance.

        Diagnostics: ``sent`` (0 or 1), ``neighbours_heard``, ``bound_guaranteed`` (0 or 1), and of a design
        that solves programs ``solver_failures``, those so far that were replaced by gains in closed form.
        """
        design = self._design
        diagnostics = {
            "sent": float(self._sent),
            "neighbours_heard": float(self._heard),
            "bound_guaranteed": float(design.guaranteed),
        }
        covariance = self._bound
        if design.ellipsoidal:
            covariance = covariance / len(covariance)
            diagnostics["solver_failures"] = float(design.failures)
        return Belief(self._state, covariance, refers_to=step + 1, diagnostics=diagnostics)

    def _told(self, flag: float, innovation: Vector | None) -> Vector:
        """Return the payload of this step."""
        self._payload = self._layout.payload(self._state, self._bound, flag, self._slack, innovation)
        return self._payload

    def _disagreement(self) -> Vector:
        """Return ``Psi_i`` (m,) of the innovations that were last sent."""
        others = self._memory.innovations.values()
        disagreement: Vector = sum(others, -len(others) * self._last)
        return disagreement

    def _unheard(self, innovation: Vector, disagreement: Vector) -> float:
        """Return what ``f' Phi f`` stays below, for an innovation that was not sent."""
        if self._relative is not None:
            return self._relative.bound(disagreement)
        difference = innovation - self._last
        return float(difference.dot(difference))

    def _local(self, heard: Heard) -> Local:
        """Return what the node knows in this step of itself and of the neighbours that it heard."""
        which = (0, *[self._place[name] for name in heard.names])
        F, remainder, directions, driver = self._linearisation.at(self._state, self._bound)
        values, slopes, remainders = self._bank.linearised(which, heard.states, heard.bounds)
        return Local(
            F,
            remainder,
            directions,
            driver,
            values,
            slopes,
            remainders,
            self._noise_of(which),
            self._state - heard.states,
            heard.bounds,
            heard.slacks,
            self._unsaid,
            self._measured,
        )


class _Linearisation:
    """The plant's derivative, and the bound of what it leaves out: nothing for a plant that does not tell."""

    def __init__(self, plant: NonlinearPlant) -> None:
        n = len(plant.initial_mean)
        self._plant = plant
        self._bounded = plant if isinstance(plant, BoundedPlant) else None
        self._directions: Matrix = (
            np.zeros((n, 1)) if self._bounded is None else self._bounded.remainder_directions
        )
        self._driver: Vector = np.eye(n)[-1] if self._bounded is None else self._bounded.remainder_driver

    def at(self, state: Vector, bound: Matrix) -> tuple[Matrix, float, Matrix, Vector]:
        """Return ``F``, ``U``, ``B`` and ``d`` at an estimate (n,) with bound (n, n)."""
        remainder = 0.0 if self._bounded is None else self._bounded.remainder_bound(state, bound)
        return self._plant.jacobian(state), remainder, self._directions, self._driver


def _sensors(setting: Setting) -> list[NonlinearSensor]:
    """Return the node's own sensor and those of its neighbours, in the order of their names."""
    owners = {setting.name: setting.sensors, **dict(sorted(setting.neighbour_sensors.items()))}
    missing = [name for name in setting.neighbours if name not in owners]
    if missing:
        raise ValueError(f"{setting.name}: the sensors of {', '.join(missing)} are not known")
    found: list[NonlinearSensor] = []
    for name, sensors in owners.items():
        if len(sensors) != 1:
            raise ValueError(f"{name} listens to {len(sensors)} sensors; give it exactly one")
        found += nonlinear_sensors(replace(setting, name=name, sensors=sensors)).values()
    outputs = {len(sensor.R) for sensor in found}
    if len(outputs) > 1:
        raise ValueError(
            f"{setting.name}: its sensor and its neighbours' have {sorted(outputs)} outputs; "
            "innovations can be compared only when they have as many"
        )
    return found


def _size_weights(given: list[float] | None, states: int) -> Vector:
    weights = np.ones(states) if given is None else np.array(given, dtype=np.float64)
    if weights.shape != (states,) or not np.all(weights > 0.0):
        raise ValueError(f"size_weights is {given}; give {states} positive numbers")
    return weights


def _design(choice: GainDesign, shares: Shares, Q: Matrix, members: int, weights: Vector) -> Design:
    if choice.lmi is not None:
        return Lmi(shares, Q, variant=choice.lmi, members=members, weights=weights)
    return Riccati(shares, Q, variant=choice.riccati or "nominal")
