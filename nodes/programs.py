"""The programs of plant, sensors and controllers: they bring the pure mathematics onto the bus."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from bus import keys
from bus.integrity import Gate, seal_of
from bus.messages import Credit, Estimate, Inbox, Truth
from bus.packets import UNSEALED, Packet, Vector, packets_of_inbox, transmission
from bus.plan import ControllerPlan, Plan
from bus.program import Port, Program, every_step
from nodes.contract import Controller, Plant, Sensor, Trigger
from nodes.signal_attack import SignalAttacks


def is_finite(values: list[float]) -> bool:
    """Return whether values may travel: JSON holds neither NaN nor infinity."""
    return math.isfinite(sum(values)) or all(map(math.isfinite, values))  # a sum may overflow


def _finite(values: Vector, what: str) -> list[float]:
    """Return values as they travel; raises FloatingPointError for what cannot."""
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


def sealed(plan: Plan, name: str, stream: str) -> Callable[[int, int, list[float] | None], int]:
    """Return what seals a node's payloads of a stream, given their step and sequence number."""
    seal = seal_of(plan, name)
    if seal is None:
        return lambda step, sequence, values: UNSEALED

    def check(step: int, sequence: int, values: list[float] | None) -> int:
        return UNSEALED if values is None else seal(Packet(name, step, sequence, stream, np.array(values)))

    return check


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
    topic = keys.tx(name, keys.MEASUREMENT)
    signals = SignalAttacks(plan)
    check = sealed(plan, name, keys.MEASUREMENT)

    def one_step(step: int) -> Program:
        truth: Truth = yield truth_topic
        entering = {"attack": signals.at(step)} if signals.exist else {}
        measured = sensor.observe(step, np.array(truth.state), noise, **entering)
        values: list[float] | None = _finite(measured, "the measurement")
        if trigger is not None and not trigger.sends(step, measured):
            values = None
        port.send(topic, transmission(step, truth.t, 0, step, values, check(step, step, values)))

    return every_step(name, plan.silent_from(name), one_step)


def controller_program(port: Port, plan: Plan, own: ControllerPlan, controller: Controller) -> Program:
    """Send the input that each estimate asks for; of a diverged one, what the controller decides."""
    estimate_topic = keys.estimate(own.estimator)
    topic = keys.tx(own.name, keys.CONTROL)
    check = sealed(plan, own.name, keys.CONTROL)

    def one_step(step: int) -> Program:
        estimate: Estimate = yield estimate_topic
        state = None if estimate.diverged else np.array(estimate.state)
        values = _finite(controller.control(step, state), "the input")
        port.send(topic, transmission(step, step * plan.period_s, 0, step, values, check(step, step, values)))

    return every_step(own.name, plan.silent_from(own.name), one_step)
