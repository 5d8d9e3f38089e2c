"""The program of an estimator: it brings a method's mathematics onto the bus, and guards the bus from it."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np

from bus import keys
from bus.integrity import Gate
from bus.messages import Estimate, Inbox
from bus.packets import Packet, packets_of_inbox, transmission
from bus.plan import EstimatorPlan, Plan
from bus.program import Port, Program, every_step
from nodes.contract import Belief, Estimator, Trigger
from nodes.programs import Pace, is_finite, sealed, watch

_log = logging.getLogger("gauntlet.node")


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
        if not is_finite(numbers):
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
            if is_finite(
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
    port: Port,
    plan: Plan,
    own: EstimatorPlan,
    estimator: Estimator,
    state_size: int,
    window: int,
    trigger: Trigger | None = None,
) -> Program:
    """Correct, exchange and publish the estimate of every step; without a sensor, as credits allow.

    The event trigger keeps back payloads; what the neighbours get is then a quiet slot.
    """
    inbox_topic = keys.rx(own.name, keys.CORRECT)
    exchange_topic = keys.rx(own.name, keys.EXCHANGE)
    outgoing_topic = keys.tx(own.name, keys.EXCHANGE)
    estimate_topic = keys.estimate(own.name)
    control_topic = keys.rx(own.name, keys.CONTROL)
    is_heard = any(link.source == own.name for link in plan.links_of(keys.EXCHANGE))
    guard = _Guard(own.name, estimator, state_size)
    pace = Pace(own.name, window)
    measured = Gate(plan, own.sensors)
    exchanged = Gate(plan, own.neighbours)
    controlled = Gate(plan, own.controllers)
    check = sealed(plan, own.name, keys.EXCHANGE)
    tell = watch(port, plan, own.name)
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
                if payload is not None and trigger is not None and not trigger.sends(step, np.array(payload)):
                    payload = None
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
