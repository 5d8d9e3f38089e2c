"""The program of an estimator: it brings a method's mathematics onto the bus, and guards the bus from it."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from bus import keys
from bus.integrity import Gate
from bus.messages import Inbox
from bus.packets import ORACLE, Delivery, Packet, Vector, holds, packets_of_inbox
from bus.plan import EstimatorPlan, Plan
from bus.program import Port, Program, every_step, outlet
from nodes.checked import Shapes, checked, checked_payload
from nodes.contract import Belief, Estimator, Trigger
from nodes.programs import Pace, is_finite, sender, watch
from nodes.published import Published, published

_log = logging.getLogger("gauntlet.node")


class _Guard:
    """Stands between an estimator and the bus: checks what it says, and keeps a diverged one's numbers back.

    From its first number that is not finite on, a diverged estimator only says that it has diverged.
    """

    def __init__(self, name: str, estimator: Estimator, state_size: int) -> None:
        self._name = name
        self._estimator = estimator
        self._shapes: Shapes = ((state_size,), (state_size, state_size))
        self.diverged = False

    def _declare(self, step: int, why: str) -> None:
        self.diverged = True
        _log.warning("%s diverged in step %d: %s", self._name, step, why)

    def payload(self, step: int, round_: int | None, packets: Sequence[Packet]) -> Vector | None:
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
        payload = checked_payload(values)
        if not is_finite(payload.tolist()):
            self._declare(step, "its payload is not finite")
            return None
        return payload

    def control(self, step: int, packets: Sequence[Packet]) -> None:
        """Tell the estimator which input was commanded, if it cares."""
        control = getattr(self._estimator, "control", None)
        if control is not None and not self.diverged:
            control(step, packets)

    def estimate(self, step: int, t: float, refused: int) -> Published:
        """Return what publishes the estimator's belief, or its divergence."""
        if not self.diverged:
            belief, finite = checked(self._estimator.estimate(step), self._shapes)
            if finite:
                return published(step, t, belief, refused)
            self._declare(step, "its estimate is not finite")
        return published(step, t, Belief(np.zeros(0), np.zeros((0, 0))), refused)


class _Admission:
    """Lets in what a node may believe of what its inboxes hold; ``refused`` counts the rest of a step."""

    def __init__(self) -> None:
        self.refused = 0

    def admit(self, inbox: Inbox | Delivery, gate: Gate, hears_oracles: bool = False) -> Sequence[Packet]:
        """Return the packets that a gate lets in, and what oracles tell a node that hears them."""
        packets = packets_of_inbox(inbox)
        if isinstance(inbox, Delivery) and inbox.untouched:
            return packets
        if holds(inbox, ORACLE):
            told = [packet for packet in packets if hears_oracles and packet.kind == ORACLE]
            let_in = gate.admit([packet for packet in packets if packet.kind != ORACLE])
            self.refused += len(packets) - len(let_in) - len(told)
            return [*let_in, *told]
        if gate.is_open_to(inbox.source):
            return packets
        let_in = gate.admit(packets)
        self.refused += len(packets) - len(let_in)
        return let_in


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
    control_topic = keys.rx(own.name, keys.CONTROL)
    is_heard = plan.is_heard(own.name, keys.EXCHANGE)
    guard = _Guard(own.name, estimator, state_size)
    pace = Pace(own.name, window)
    measured, exchanged, controlled = (
        Gate(plan, sources) for sources in (own.sensors, own.neighbours, own.controllers)
    )
    hears_oracles = bool(own.oracles)
    admission = _Admission()
    admit = admission.admit
    send = sender(port, plan, own.name, keys.EXCHANGE)
    put = outlet(port, keys.estimate(own.name))
    tell = watch(port, plan, own.name)

    def one_step(step: int) -> Program:
        packets: Sequence[Packet] = ()
        admission.refused = 0
        if not own.sensors:
            yield from pace.wait(step)
        if step and own.controllers:
            guard.control(step - 1, admit((yield control_topic), controlled))
        if own.sensors:
            packets = admit((yield inbox_topic), measured, hears_oracles)
        payload = guard.payload(step, None, packets)
        for round_ in range(own.rounds):
            if is_heard:
                if payload is not None and trigger is not None and not trigger.sends(step, np.array(payload)):
                    payload = None
                send(step, round_, step * own.rounds + round_, payload)
            packets = ()
            if own.neighbours:
                packets = admit((yield exchange_topic), exchanged)
            payload = guard.payload(step, round_, packets)
        estimate = guard.estimate(step, step * plan.period_s, admission.refused)
        put(estimate)
        tell(step, [float(sum([bool(detection.alarm) for detection in estimate.detections]))])

    return every_step(own.name, plan.silent_from(own.name), one_step)
