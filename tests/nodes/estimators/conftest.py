"""A small world for the filters of linear Gaussian models: two sensors, one of them with two outputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from bus.packets import Packet
from nodes.contract import Setting
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.sensors.linear import Linear as LinearSensor


@dataclass(frozen=True)
class World:
    plant: LinearPlant
    sensors: dict[str, LinearSensor]

    def setting(self, *heard: str, neighbours: dict[str, float] | None = None) -> Setting:
        sensors = {name: self.sensors[name] for name in heard}
        return Setting("e1", self.plant, sensors, neighbours or {}, np.random.default_rng(0))

    def trial(self, seed: int, steps: int) -> tuple[np.ndarray, list[list[Packet]]]:
        """Return the states (steps, n) and the packets of each step, from all sensors."""
        rng = np.random.default_rng(seed)
        states = [self.plant.initial_state(rng)]
        for step in range(1, steps):
            states.append(self.plant.advance(step, states[-1], rng))
        packets = [
            [measured(step, name, sensor.observe(step, x, rng)) for name, sensor in self.sensors.items()]
            for step, x in enumerate(states)
        ]
        return np.array(states), packets


def measured(step: int, source: str, values: object) -> Packet:
    return Packet(source, step, step, "measurement", np.array(values, dtype=np.float64))


@pytest.fixture(scope="session")
def world() -> World:
    plant = LinearPlant(
        0.1,
        A=[[1.0, 0.1, 0.0], [0.0, 1.0, 0.1], [-0.1, 0.0, 0.9]],
        process_noise=Gaussian(covariance=[[0.02, 0.01, 0.0], [0.01, 0.03, 0.0], [0.0, 0.0, 0.05]]),
        initial=Gaussian(std=[1.0, 0.5, 0.2], mean=[1.0, -1.0, 0.5]),
    )
    sensors = {
        "s1": LinearSensor(plant, C=[[2.0, 0.5, 0.0]], noise=Gaussian(std=0.1)),
        "s2": LinearSensor(
            plant,
            C=[[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
            noise=Gaussian(covariance=[[0.04, 0.01], [0.01, 0.09]]),
        ),
    }
    return World(plant, sensors)


@pytest.fixture(scope="session")
def packet() -> Callable[..., Packet]:
    return measured


@pytest.fixture(scope="session")
def not_linear(world: World) -> SimpleNamespace:
    """A plant and a sensor that are not linear."""
    plant = SimpleNamespace(
        initial_mean=np.zeros(3),
        initial_covariance=np.eye(3),
        state_groups={},
        initial_state=None,
        advance=None,
    )
    return SimpleNamespace(plant=plant, sensor=SimpleNamespace(observe=None))
