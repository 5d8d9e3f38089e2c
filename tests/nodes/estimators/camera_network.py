"""Eight nodes under ceiling cameras (Zhou 2020, section 3), driven by direct calls."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bus.packets import Packet
from nodes.contract import Setting
from nodes.estimators.event_triggered_extended_kalman import EventTriggeredExtendedKalman
from nodes.estimators.gain_knowledge import Deception, Local
from nodes.gaussian import Gaussian
from nodes.plants.planar_robot import PlanarRobot
from nodes.sensors.ceiling_camera import CeilingCamera
from nodes.triggers.contract import TriggerSetting
from nodes.triggers.relative import Relative

PLACES = [[0.6, 0.6], [0.6, 1.8], [1.2, 1.8], [1.8, 1.8], [2.4, 1.8], [2.4, 0.6], [1.8, 1.2], [1.2, 1.2]]
ATTACK = Deception(low=0.1, high=1.5, value=6.0)
ASSUMED = {
    "assumed_attack": ATTACK,
    "process_noise": Gaussian(std=[0.02, 0.02, 0.01]),
    "initial": Gaussian(std=[0.35, 0.35, 1.0]),
    "start_error": Gaussian(std=0.1),
}

Falsify = Callable[[int, int, np.ndarray], np.ndarray]


def attack(level: float, seed: int = 0) -> Falsify:
    """Return what the attack of a level makes of a measurement of a step and node."""

    def falsify(step: int, node: int, values: np.ndarray) -> np.ndarray:
        xi = np.random.default_rng([seed, step, node]).uniform(0.1, 1.5, len(values))
        return (1.0 - xi) * values + xi * level

    return falsify


@dataclass
class Cameras:
    """A network of nodes ``e1`` to ``e{N}``; ``edges`` are pairs of indices, all pairs by default."""

    plant: Any
    sensors: Mapping[str, Any]
    edges: Sequence[tuple[int, int]]
    parameters: Mapping[str, Any]
    sigma: float | None = 0.02
    nodes: list[EventTriggeredExtendedKalman] = field(init=False)

    def __post_init__(self) -> None:
        self.nodes = [self._node(i) for i in range(len(self.sensors))]

    def neighbours(self, node: int) -> list[int]:
        return sorted({b for a, b in self.edges if a == node} | {a for a, b in self.edges if b == node})

    def _node(self, i: int) -> EventTriggeredExtendedKalman:
        rng = np.random.default_rng([7, i])
        around = self.neighbours(i)
        trigger = None
        if self.sigma is not None:
            trigger = Relative(TriggerSetting(f"e{i + 1}", self.plant, None, rng), sigma=self.sigma)
        setting = Setting(
            f"e{i + 1}",
            self.plant,
            {f"s{i + 1}": self.sensors[f"s{i + 1}"]},
            {f"e{j + 1}": 1.0 / len(around) for j in around},
            rng,
            trigger=trigger,
            neighbour_sensors={f"e{j + 1}": {f"s{j + 1}": self.sensors[f"s{j + 1}"]} for j in around},
        )
        return EventTriggeredExtendedKalman(setting, **self.parameters)

    def step(
        self, step: int, measured: Sequence[np.ndarray | None], lost: frozenset[tuple[int, int]] = frozenset()
    ) -> list[np.ndarray]:
        """Run one step; ``lost`` holds (sender, receiver). Returns the payloads."""
        payloads = []
        for i, (node, values) in enumerate(zip(self.nodes, measured, strict=True)):
            inbox = [] if values is None else [Packet(f"s{i + 1}", step, step, "measurement", values)]
            payloads.append(node.correct(step, inbox))
        for i, node in enumerate(self.nodes):
            inbox = [
                Packet(f"e{j + 1}", step, step, "exchange", payloads[j])
                for j in self.neighbours(i)
                if (j, i) not in lost
            ]
            node.exchange(step, 0, inbox)
        return payloads


def all_pairs(nodes: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(nodes) for j in range(i)]


def cameras(nodes: int = 8, *, edges: Sequence[tuple[int, int]] | None = None, **changes: Any) -> Cameras:
    """Return the paper's network, or its first nodes."""
    sigma = changes.pop("sigma", 0.02)
    plant = PlanarRobot(1.0, initial=Gaussian(std=0.0, mean=[1.5, 0.2, 0.0]))
    sensors = {
        f"s{i + 1}": CeilingCamera(plant, position=PLACES[i], noise=Gaussian(std=1.0)) for i in range(nodes)
    }
    return Cameras(
        plant, sensors, all_pairs(nodes) if edges is None else edges, {**ASSUMED, **changes}, sigma=sigma
    )


def drive(network: Cameras, steps: int, level: float, seed: int = 0) -> np.ndarray:
    """Run some steps and return the states (steps + 1, 3)."""
    rng, falsify = np.random.default_rng(seed), attack(level, seed)
    states = [network.plant.initial_state(rng)]
    for step in range(steps):
        genuine = [sensor.observe(step, states[-1], rng) for sensor in network.sensors.values()]
        network.step(step, [falsify(step, i, values) for i, values in enumerate(genuine)])
        states.append(network.plant.advance(step, states[-1], rng))
    return np.array(states)


def locals_of(network: Cameras, steps: int, level: float, seed: int = 0) -> list[Local]:
    """Run some steps and return what the nodes knew when they chose their gains, node by node a step."""
    known: list[Local] = []
    for node in network.nodes:
        design = node._design
        choose = design.gains

        def noted(local: Local, choose: Any = choose) -> Any:
            known.append(local)
            return choose(local)

        design.gains = noted  # type: ignore[method-assign]
    drive(network, steps, level, seed)
    return known
