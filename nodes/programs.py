"""The programs of plant, sensors and controllers: they bring the pure mathematics onto the bus."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from bus import keys
from bus.integrity import Gate, seal_of
from bus.messages import Credit, Estimate, Inbox, Truth
from bus.packets import Delivery, Packet, Sending, Vector, packets_of_inbox, transmission
from bus.plan import ControllerPlan, Plan
from bus.program import Port, Program, every_step, outlet
from nodes.contract import Controller, Plant, Sensor, Trigger
from nodes.published import Published
from nodes.signal_attack import SignalAttacks


def is_finite(values: list[float]) -> bool:
    """Return whether values may travel: JSON holds neither NaN nor infinity."""
    return math.isfinite(sum(values)) or all(map(math.isfinite, values))  # a sum may overflow


def _finite(values: Vector, what: str) -> list[float]:
    """Return values as JSON has them; raises FloatingPointError for what cannot travel."""
    numbers: list[float] = values.tolist()
    if not is_finite(numbers):
        raise FloatingPointError(f"{what} is not finite: {values}")
    return numbers


class Pace:
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


def watch(port: Port, plan: Plan, node: str) -> Callable[[int, list[float]], None]:
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
        inbox: Inbox | Delivery = yield self._topic
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
    pace = Pace(plan.plant.name, window)
    signals, control = SignalAttacks(plan), _Input(plan, plant)
    tell = watch(port, plan, plan.plant.name)
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


def sender(port: Port, plan: Plan, name: str, stream: str) -> Callable[[int, int, int, Vector | None], None]:
    """Return what sends a node's slots of a stream, given step, round, sequence number and payload."""
    put, seal, period_s = outlet(port, keys.tx(name, stream)), seal_of(plan, name), plan.period_s

    def send(step: int, round_: int, sequence: int, values: Vector | None) -> None:
        packets = []
        if values is not None:
            own = values.copy()
            own.flags.writeable = False
            packet = Packet(name, step, sequence, stream, own)
            if seal is not None:
                packet = Packet(name, step, sequence, stream, own, seal(packet))
            packets = [packet]
        put(Sending(step, step * period_s, round_, packets))

    return send


def sensor_program(
    port: Port,
    plan: Plan,
    name: str,
    sensor: Sensor,
    noise: np.random.Generator,
    trigger: Trigger | None = None,
) -> Program:
    """Measure the truth of every step and send it, when the event trigger lets it."""
    truth_topic = keys.truth(plan.plant.name)
    signals = SignalAttacks(plan)
    send = sender(port, plan, name, keys.MEASUREMENT)

    def one_step(step: int) -> Program:
        truth: Truth = yield truth_topic
        entering = {"attack": signals.at(step)} if signals.exist else {}
        measured = sensor.observe(step, np.array(truth.state), noise, **entering)
        _finite(measured, "the measurement")
        is_sent = trigger is None or trigger.sends(step, measured)
        send(step, 0, step, measured if is_sent else None)

    return every_step(name, plan.silent_from(name), one_step)


def controller_program(port: Port, plan: Plan, own: ControllerPlan, controller: Controller) -> Program:
    """Send the input that each estimate asks for; of a diverged one, what the controller decides."""
    estimate_topic = keys.estimate(own.estimator)
    send = sender(port, plan, own.name, keys.CONTROL)

    def one_step(step: int) -> Program:
        estimate: Estimate | Published = yield estimate_topic
        commanded = controller.control(step, None if estimate.diverged else np.array(estimate.state))
        _finite(commanded, "the input")
        send(step, 0, step, commanded)

    return every_step(own.name, plan.silent_from(own.name), one_step)
