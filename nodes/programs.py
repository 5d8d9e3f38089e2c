"""The programs of plant, sensor and estimator nodes: they bring the pure mathematics onto the bus."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np

from bus import keys
from bus.messages import Credit, Estimate, Inbox, Truth
from bus.packets import Packet, Vector, packets_of_inbox, transmission
from bus.plan import EstimatorPlan, Plan
from bus.program import Port, Program, every_step
from nodes.contract import Belief, Estimator, Plant, Sensor

_log = logging.getLogger("gauntlet.node")


def _is_finite(values: list[float]) -> bool:
    """Return whether values may travel: JSON holds neither NaN nor infinity."""
    return all(map(math.isfinite, values))


def _finite(values: Vector, what: str) -> list[float]:
    """Return values as they travel; raises FloatingPointError for what cannot."""
    numbers: list[float] = values.tolist()
    if not _is_finite(numbers):
        raise FloatingPointError(f"{what} is not finite: {values}")
    return numbers


class _Pace:
    """Holds back who is driven by nobody's messages: at most ``window`` steps ahead of what is recorded."""

    def __init__(self, name: str, window: int) -> None:
        self._topic = keys.credit(name)
        self._window = window
        self._recorded = 0

    def wait(self, step: int) -> Program:
        """Wait until a step may begin."""
        while step >= self._recorded + self._window:
            credit: Credit = yield self._topic
            self._recorded = max(self._recorded, credit.steps_recorded)


def plant_program(
    port: Port,
    plan: Plan,
    plant: Plant,
    window: int,
    initial: np.random.Generator,
    noise: np.random.Generator,
) -> Program:
    """Move the state and publish the truth, at most ``window`` steps ahead of what is recorded."""
    topic = keys.truth(plan.plant.name)
    pace = _Pace(plan.plant.name, window)
    state = np.zeros(0)

    def one_step(step: int) -> Program:
        nonlocal state
        yield from pace.wait(step)
        state = plant.initial_state(initial) if step == 0 else plant.advance(step, state, noise)
        port.send(topic, Truth(step=step, t=step * plan.period_s, state=_finite(state, "the plant's state")))

    return every_step(plan.plant.name, plan.steps, one_step)


def sensor_program(port: Port, plan: Plan, name: str, sensor: Sensor, noise: np.random.Generator) -> Program:
    """Measure the truth of every step and send it."""
    truth_topic = keys.truth(plan.plant.name)
    topic = keys.tx(name, keys.MEASUREMENT)

    def one_step(step: int) -> Program:
        truth: Truth = yield truth_topic
        values = sensor.observe(step, np.array(truth.state), noise)
        port.send(topic, transmission(step, truth.t, 0, step, _finite(values, "the measurement")))

    return every_step(name, plan.steps, one_step)


class _Guard:
    """Stands between an estimator and the bus: checks shapes, and keeps a diverged one's numbers back.

    From its first number that is not finite on, a diverged estimator only says that it has diverged.
    """

    def __init__(self, name: str, estimator: Estimator, state_size: int) -> None:
        self._name = name
        self._estimator = estimator
        self._shapes = ((state_size,), (state_size, state_size))
        self.diverged = False

    def _declare(self, step: int, why: str) -> None:
        self.diverged = True
        _log.warning("%s diverged in step %d: %s", self._name, step, why)

    def payload(self, step: int, round_: int | None, packets: Sequence[Packet]) -> list[float] | None:
        """Return what the estimator sends after `correct` (``round_`` None) or `exchange`, if it can."""
        if self.diverged:
            return None
        try:
            if round_ is None:
                values = self._estimator.correct(step, packets)
            else:
                values = self._estimator.exchange(step, round_, packets)
        except np.linalg.LinAlgError as error:
            self._declare(step, str(error))
            return None
        if values is None:
            return None
        if values.ndim != 1:
            raise ValueError(f"a payload has one dimension, this one has the shape {values.shape}; ravel it")
        numbers: list[float] = values.tolist()
        if not _is_finite(numbers):
            self._declare(step, "its payload is not finite")
            return None
        return numbers

    def estimate(self, step: int, t: float) -> Estimate:
        """Return the message that publishes the estimator's belief, or its divergence."""
        if not self.diverged:
            belief = self._estimator.estimate(step)
            if (belief.state.shape, belief.covariance.shape) != self._shapes:
                raise ValueError(
                    f"a belief has state and covariance of the shapes {self._shapes}, "
                    f"this one {(belief.state.shape, belief.covariance.shape)}"
                )
            message = _estimate_message(step, t, belief)
            scalars = [message.nis, *message.detector_statistic, *message.diagnostic_value]
            if _is_finite(message.state) and _is_finite(message.covariance) and _is_finite(scalars):
                return message
            self._declare(step, "its estimate is not finite")
        return _estimate_message(step, t, Belief(np.zeros(0), np.zeros((0, 0))))


def _estimate_message(step: int, t: float, belief: Belief) -> Estimate:
    """Return the message of a belief; numbers of numpy's own types become Python's, which JSON knows."""
    covariance: list[float] = belief.covariance.ravel().tolist()
    variances = covariance[:: belief.state.size + 1]
    detections = belief.detections
    return Estimate(
        step=step,
        t=t,
        refers_to=step if belief.refers_to is None else belief.refers_to,
        diverged=not belief.state.size,
        state=belief.state.tolist(),
        covariance=covariance,
        covariance_shape=list(belief.covariance.shape),
        sigma=[math.sqrt(variance) if variance > 0.0 else 0.0 for variance in variances],
        nis=float(belief.nis),
        nis_dof=int(belief.nis_dof),
        detector_source=[detection.source for detection in detections],
        detector_sequence=[detection.sequence for detection in detections],
        detector_statistic=[float(detection.statistic) for detection in detections],
        detector_alarm=[bool(detection.alarm) for detection in detections],
        diagnostic_name=list(belief.diagnostics),
        diagnostic_value=[float(value) for value in belief.diagnostics.values()],
    )


def estimator_program(
    port: Port, plan: Plan, own: EstimatorPlan, estimator: Estimator, state_size: int, window: int
) -> Program:
    """Correct, exchange and publish the estimate of every step; without a sensor, as credits allow."""
    inbox_topic = keys.rx(own.name, keys.CORRECT)
    exchange_topic = keys.rx(own.name, keys.EXCHANGE)
    outgoing_topic = keys.tx(own.name, keys.EXCHANGE)
    estimate_topic = keys.estimate(own.name)
    is_heard = any(link.source == own.name for link in plan.links_of(keys.EXCHANGE))
    guard = _Guard(own.name, estimator, state_size)
    pace = _Pace(own.name, window)

    def one_step(step: int) -> Program:
        t = step * plan.period_s
        packets: Sequence[Packet] = ()
        if own.sensors:
            inbox: Inbox = yield inbox_topic
            packets = packets_of_inbox(inbox)
        else:
            yield from pace.wait(step)
        payload = guard.payload(step, None, packets)
        for round_ in range(own.rounds):
            if is_heard:
                port.send(outgoing_topic, transmission(step, t, round_, step * own.rounds + round_, payload))
            packets = ()
            if own.neighbours:
                inbox = yield exchange_topic
                packets = packets_of_inbox(inbox)
            payload = guard.payload(step, round_, packets)
        port.send(estimate_topic, guard.estimate(step, t))

    return every_step(own.name, plan.steps, one_step)
