"""The programs of plant, sensor and estimator nodes: they bring the pure mathematics onto the bus."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence

import numpy as np

from bus import keys
from bus.integrity import Gate, seal_of
from bus.messages import Credit, Estimate, Inbox, Truth
from bus.packets import UNSEALED, Packet, Vector, packets_of_inbox, transmission
from bus.plan import ControllerPlan, EstimatorPlan, Plan
from bus.program import Port, Program, every_step
from nodes.contract import Belief, Controller, Estimator, Plant, Sensor
from nodes.signal_attack import SignalAttacks

_log = logging.getLogger("gauntlet.node")


def _is_finite(values: list[float]) -> bool:
    """Return whether values may travel: JSON holds neither NaN nor infinity."""
    return math.isfinite(sum(values)) or all(map(math.isfinite, values))  # a sum may overflow


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


def _watch(port: Port, plan: Plan, node: str) -> Callable[[int, list[float]], None]:
    """Return what tells the channel's triggers about a node; it does nothing when none watches the node."""
    topic = keys.tx(node, keys.WATCH)

    def tell(step: int, values: list[float]) -> None:
        port.send(topic, transmission(step, step * plan.period_s, 0, step, values))

    return tell if node in plan.watched else lambda step, values: None


class _Input:
    """The input (p,) that a plant applies: the newest that was received; a lost one is zero, or held.

    What is no input of this plant by its size counts as lost.
    """

    def __init__(self, plan: Plan, plant: Plant) -> None:
        self.expected = bool(plan.plant.controllers)
        self._topic = keys.rx(plan.plant.name, keys.CONTROL)
        self._gate = Gate(plan, plan.plant.controllers)
        size = np.shape(getattr(plant, "B", np.zeros((0, 0))))[1]
        self._holds = bool(getattr(plant, "holds_input", False))
        self._zero: Vector = np.zeros(size)
        self.value: Vector = self._zero

    def receive(self) -> Program:
        """Take the inbox of the step before."""
        inbox: Inbox = yield self._topic
        admitted = self._gate.admit(packets_of_inbox(inbox))
        packets = [packet for packet in admitted if packet.values.shape == self._zero.shape]
        if packets:
            self.value = max(packets, key=lambda packet: packet.sequence).values
        elif not self._holds:
            self.value = self._zero


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
    signals, control = SignalAttacks(plan), _Input(plan, plant)
    tell = _watch(port, plan, plan.plant.name)
    state = np.zeros(0)

    def entering(step: int) -> dict[str, Vector]:
        """Return what enters the dynamics on the way into a step, besides the noise."""
        found = {"control": control.value} if control.expected else {}
        return found | ({"attack": signals.at(step - 1)} if signals.exist else {})

    def one_step(step: int) -> Program:
        nonlocal state
        yield from pace.wait(step)
        if step and control.expected:
            yield from control.receive()
        if step == 0:
            state = plant.initial_state(initial)
        else:
            state = plant.advance(step, state, noise, **entering(step))
        values = _finite(state, "the plant's state")
        port.send(
            topic,
            Truth(
                step=step,
                t=step * plan.period_s,
                state=values,
                control=_finite(control.value, "the input") if step and control.expected else [],
                attack=signals.at(step).tolist() if signals.exist else [],
            ),
        )
        tell(step, values)

    return every_step(plan.plant.name, plan.steps, one_step)


def _sealed(plan: Plan, name: str, stream: str) -> Callable[[int, int, list[float] | None], int]:
    """Return what seals a node's payloads of a stream, given their step and sequence number."""
    seal = seal_of(plan, name)
    if seal is None:
        return lambda step, sequence, values: UNSEALED

    def check(step: int, sequence: int, values: list[float] | None) -> int:
        return UNSEALED if values is None else seal(Packet(name, step, sequence, stream, np.array(values)))

    return check


def sensor_program(port: Port, plan: Plan, name: str, sensor: Sensor, noise: np.random.Generator) -> Program:
    """Measure the truth of every step and send it."""
    truth_topic = keys.truth(plan.plant.name)
    topic = keys.tx(name, keys.MEASUREMENT)
    signals = SignalAttacks(plan)
    check = _sealed(plan, name, keys.MEASUREMENT)

    def one_step(step: int) -> Program:
        truth: Truth = yield truth_topic
        entering = {"attack": signals.at(step)} if signals.exist else {}
        measured = sensor.observe(step, np.array(truth.state), noise, **entering)
        values = _finite(measured, "the measurement")
        port.send(topic, transmission(step, truth.t, 0, step, values, check(step, step, values)))

    return every_step(name, plan.silent_from(name), one_step)


def controller_program(port: Port, plan: Plan, own: ControllerPlan, controller: Controller) -> Program:
    """Send the input that each estimate asks for; of a diverged one, what the controller decides."""
    estimate_topic = keys.estimate(own.estimator)
    topic = keys.tx(own.name, keys.CONTROL)
    check = _sealed(plan, own.name, keys.CONTROL)

    def one_step(step: int) -> Program:
        estimate: Estimate = yield estimate_topic
        state = None if estimate.diverged else np.array(estimate.state)
        values = _finite(controller.control(step, state), "the input")
        port.send(topic, transmission(step, step * plan.period_s, 0, step, values, check(step, step, values)))

    return every_step(own.name, plan.silent_from(own.name), one_step)


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

    def control(self, step: int, packets: Sequence[Packet]) -> None:
        """Tell the estimator which input was commanded, if it cares."""
        control = getattr(self._estimator, "control", None)
        if control is not None and not self.diverged:
            control(step, packets)

    def estimate(self, step: int, t: float, refused: int) -> Estimate:
        """Return the message that publishes the estimator's belief, or its divergence."""
        if not self.diverged:
            belief = self._estimator.estimate(step)
            if (belief.state.shape, belief.covariance.shape) != self._shapes:
                raise ValueError(
                    f"a belief has state and covariance of the shapes {self._shapes}, "
                    f"this one {(belief.state.shape, belief.covariance.shape)}"
                )
            message = _estimate_message(step, t, belief, refused)
            if _is_finite(
                [
                    *message.state,
                    *message.covariance,
                    message.nis,
                    *message.detector_statistic,
                    *message.diagnostic_value,
                ]
            ):
                return message
            self._declare(step, "its estimate is not finite")
        return _estimate_message(step, t, Belief(np.zeros(0), np.zeros((0, 0))), refused)


def _estimate_message(step: int, t: float, belief: Belief, refused: int) -> Estimate:
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
        refused=refused,
    )


def estimator_program(
    port: Port, plan: Plan, own: EstimatorPlan, estimator: Estimator, state_size: int, window: int
) -> Program:
    """Correct, exchange and publish the estimate of every step; without a sensor, as credits allow."""
    inbox_topic = keys.rx(own.name, keys.CORRECT)
    exchange_topic = keys.rx(own.name, keys.EXCHANGE)
    outgoing_topic = keys.tx(own.name, keys.EXCHANGE)
    estimate_topic = keys.estimate(own.name)
    control_topic = keys.rx(own.name, keys.CONTROL)
    is_heard = any(link.source == own.name for link in plan.links_of(keys.EXCHANGE))
    guard = _Guard(own.name, estimator, state_size)
    pace = _Pace(own.name, window)
    measured = Gate(plan, own.sensors)
    exchanged = Gate(plan, own.neighbours)
    controlled = Gate(plan, own.controllers)
    check = _sealed(plan, own.name, keys.EXCHANGE)
    tell = _watch(port, plan, own.name)
    refused = 0

    def admitted(inbox: Inbox, gate: Gate) -> Sequence[Packet]:
        nonlocal refused
        packets = packets_of_inbox(inbox)
        if gate.is_open_to(inbox.source):
            return packets
        let_in = gate.admit(packets)
        refused += len(packets) - len(let_in)
        return let_in

    def one_step(step: int) -> Program:
        nonlocal refused
        t = step * plan.period_s
        packets: Sequence[Packet] = ()
        refused = 0
        if not own.sensors:
            yield from pace.wait(step)
        if step and own.controllers:
            guard.control(step - 1, admitted((yield control_topic), controlled))
        if own.sensors:
            packets = admitted((yield inbox_topic), measured)
        payload = guard.payload(step, None, packets)
        for round_ in range(own.rounds):
            if is_heard:
                number = step * own.rounds + round_
                seal = check(step, number, payload)
                port.send(outgoing_topic, transmission(step, t, round_, number, payload, seal))
            packets = ()
            if own.neighbours:
                packets = admitted((yield exchange_topic), exchanged)
            payload = guard.payload(step, round_, packets)
        estimate = guard.estimate(step, t, refused)
        port.send(estimate_topic, estimate)
        tell(step, [float(sum(estimate.detector_alarm))])

    return every_step(own.name, plan.silent_from(own.name), one_step)
