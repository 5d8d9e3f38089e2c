"""What a plant, a sensor and an estimator are: plain objects that know no bus, no file and no clock.

Matrices keep the names of the literature: ``A`` (n, n) dynamics, ``Q`` (n, n) process noise covariance, ``C``
(m, n) measurement, ``R`` (m, m) measurement noise covariance, ``P`` (n, n) error covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol, runtime_checkable

import msgspec
import numpy as np

from bus.packets import Packet, Vector

Matrix = np.ndarray[tuple[int, int], np.dtype[np.float64]]

Listens = Literal["paired", "all"]
"""The sensors that a method is given unless the topology says which: those of its own number, or all."""


class Plant(Protocol):
    """A plant's model. It holds no state: estimators may be given it without being given the truth.

    A kind is constructed as ``Kind(period_s, **parameters)``.
    """

    state_groups: Mapping[str, Sequence[int]]
    """Names for parts of the state, by index: the score reports errors by group."""
    initial_mean: Vector
    """Mean (n,) of the initial state."""
    initial_covariance: Matrix
    """Covariance (n, n) of the initial state."""

    def initial_state(self, rng: np.random.Generator) -> Vector:
        """Draw the state (n,) of step 0."""
        ...

    def advance(self, step: int, state: Vector, rng: np.random.Generator, **entering: Vector) -> Vector:
        """Return the state (n,) of ``step``, given that of the step before.

        ``entering`` holds ``control`` (p,) when the topology has a controller, and ``attack`` (q,), the value
        of the step before, when it has a signal attack; a plant that takes neither need not name it.
        """
        ...


@runtime_checkable
class LinearPlant(Plant, Protocol):
    """A plant ``x+ = A x + w`` with ``w ~ N(0, Q)``."""

    A: Matrix
    Q: Matrix


@runtime_checkable
class ControlledPlant(LinearPlant, Protocol):
    """A plant ``x+ = A x + B u + w`` with an input ``u`` (p,)."""

    B: Matrix


@runtime_checkable
class NonlinearPlant(Plant, Protocol):
    """A plant ``x+ = f(x) + w`` with zero-mean ``w`` of covariance ``Q``: what Kalman-type filters need."""

    Q: Matrix

    def transition(self, states: Matrix) -> Matrix:
        """Return ``f`` (N, n) of each of N states (N, n)."""
        ...

    def jacobian(self, state: Vector) -> Matrix:
        """Return the derivative (n, n) of ``f`` at a state (n,)."""
        ...


@runtime_checkable
class SampledPlant(Plant, Protocol):
    """A plant of any law that can be drawn from: what particle filters need."""

    def sample_initial(self, number: int, rng: np.random.Generator) -> Matrix:
        """Draw states (number, n) of step 0."""
        ...

    def sample(self, states: Matrix, rng: np.random.Generator) -> Matrix:
        """Draw a successor (N, n) of each of N states (N, n), with as many draws whatever they are."""
        ...


class Sensor(Protocol):
    """A sensor's model. A kind is constructed as ``Kind(plant, **parameters)``."""

    def observe(self, step: int, state: Vector, rng: np.random.Generator, **entering: Vector) -> Vector:
        """Measure (m,) the true state (n,).

        ``entering`` holds ``attack`` (q,), this step's value, when the topology has a signal attack.
        """
        ...


@runtime_checkable
class LinearSensor(Sensor, Protocol):
    """A sensor ``y = C x + v`` with ``v ~ N(0, R)``."""

    C: Matrix
    R: Matrix


@runtime_checkable
class NonlinearSensor(Sensor, Protocol):
    """A sensor ``y = g(x) + v`` with zero-mean ``v`` of covariance ``R``: what Kalman-type filters need."""

    R: Matrix

    def measure(self, states: Matrix, signals: Matrix | None = None) -> Matrix:
        """Return ``g`` (N, m) of each of N states (N, n), and of an attack's signals (N, q) if it has any."""
        ...

    def jacobian(self, state: Vector) -> Matrix:
        """Return the derivative (m, n) of ``g`` at a state (n,)."""
        ...


@runtime_checkable
class LikelihoodSensor(Sensor, Protocol):
    """A sensor of any law whose likelihood is known: what particle filters need."""

    def measure(self, states: Matrix, signals: Matrix | None = None) -> Matrix:
        """Return the measurement without noise (N, m) of each of N states (N, n)."""
        ...

    def log_likelihood(self, values: Vector, predicted: Matrix) -> Vector:
        """Return the log density (N,) of a measurement (m,) around each of N others (N, m).

        A constant may be left out.
        """
        ...


class Trigger(Protocol):
    """An event trigger. A kind is constructed as ``Kind(setting, **parameters)``; see `nodes.triggers`."""

    def sends(self, step: int, values: Vector, reference: Vector | None = None) -> bool:
        """Return whether the values (m,) are sent, and remember what was; asked once a slot, in order.

        ``reference`` is what some kinds compare with, where the method knows it better than the trigger.
        """
        ...


@dataclass(frozen=True)
class Setting:
    """What an estimator is told of the world: models, never states."""

    name: str
    """Its own node name."""
    plant: Plant
    sensors: Mapping[str, Sensor]
    """The models of the sensors that it listens to, by node name."""
    neighbours: Mapping[str, float]
    """The estimators that send to it, with the graph's weight ``h_ij`` of each."""
    rng: np.random.Generator
    """Its own random stream."""
    told_attacks: bool = False
    """Whether the topology grants it the truth about the attacks on its measurements, as packets of the kind
    `bus.packets.ORACLE`."""
    neighbour_sensors: Mapping[str, Mapping[str, Sensor]] = field(default_factory=dict)
    """By neighbour, the models of the sensors that it listens to; empty unless the kind asks for them.

    A kind asks by the class attribute ``knows_neighbours_sensors = True``.
    """
    trigger: Trigger | None = None
    """Its own event trigger, for a method whose class says ``takes_trigger = True``: it asks the trigger
    itself. That of any other method acts on its payloads, behind its back."""
    sensor_triggers: Mapping[str, Trigger] = field(default_factory=dict)
    """Copies of the event triggers of the sensors that it listens to, by node name."""


class Detection(msgspec.Struct, frozen=True):
    """A detector's verdict on one packet: ``alarm`` is True when the packet was judged attacked."""

    source: str
    sequence: int
    statistic: float
    alarm: bool


class Belief(msgspec.Struct, frozen=True):
    """What an estimator publishes at the end of a step.

    ``state`` (n,) with error ``covariance`` (n, n) refers to the step ``refers_to`` (None: the current one).
    ``nis`` is the normalised innovation squared of the packets of this step under the filter's own
    covariance, with ``nis_dof`` degrees of freedom (0: none came). ``diagnostics`` are further named numbers
    for the log.
    """

    state: Vector
    covariance: Matrix
    refers_to: int | None = None
    nis: float = 0.0
    nis_dof: int = 0
    detections: Sequence[Detection] = ()
    diagnostics: Mapping[str, float] = {}


class Estimator(Protocol):
    """An estimator. A kind is constructed as ``Kind(setting, **parameters)``.

    Each step calls, in order: `correct` once, `exchange` ``rounds`` times, `estimate` once. A payload that is
    returned goes to all neighbours through the channel, if the node's event trigger lets it; None is a quiet
    slot. A method with ``takes_trigger = True`` asks the trigger itself, may fill a slot all the same, and
    says in the diagnostic ``sent`` which share of the step's events was sent. Payloads are (m,) arrays whose
    layout is the method's own. A lost packet is simply not in ``packets``.

    The class attribute ``listens`` (`Listens`) says which sensors it is given unless the topology does so;
    without it, ``paired``.

    One that predicts with the plant's input has a further method ``control(step, packets)``: before `correct`
    of the step after, it is given what controllers commanded in ``step``.

    One that can be told of the attacks on its measurements has the attribute ``takes_oracles``, True when it
    makes use of it; to no other can the privilege be granted.
    """

    rounds: int
    """Exchange rounds in each step; 0 for an estimator that works alone."""

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Take this step's measurements; return the payload of round 0 (ignored when ``rounds`` is 0).

        The values of packets are for reading only: others may be given the same arrays.
        """
        ...

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Take the neighbours' payloads of a round; return that of the next (ignored after the last)."""
        ...

    def estimate(self, step: int) -> Belief:
        """Return the belief to publish for this step."""
        ...


@dataclass(frozen=True)
class ControllerSetting:
    """What a controller is told of the world."""

    name: str
    """Its own node name."""
    plant: Plant
    rng: np.random.Generator
    """Its own random stream."""


class Controller(Protocol):
    """A controller. A kind is constructed as ``Kind(setting, **parameters)``."""

    def control(self, step: int, state: Vector | None) -> Vector:
        """Return the input (p,) for step ``step + 1``, given the estimate (n,) of ``step`` or None."""
        ...
