"""The sensor network of Ding 2021, section V, driven by direct calls: no bus, no channel process."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import networkx as nx
import numpy as np
import pytest

from bus.packets import Packet
from bus.random_streams import random_stream
from nodes.contract import Belief, Setting
from nodes.gaussian import Gaussian
from nodes.plants.constant_acceleration import ConstantAcceleration
from nodes.sensors.linear import Linear as LinearSensor

PERIOD_S = 0.05
STEPS = 150
FAILURE, RECOVERY = 0.1, 0.92
GRAPH_SEED = 0

Make = Callable[[Setting], Any]
Attacks = Mapping[str, tuple[float, int, int]]


@dataclass(frozen=True)
class Scenario:
    """What happens to the network in one trial, whatever estimators it runs."""

    truth: np.ndarray
    """(steps, n)"""
    measurements: Mapping[str, np.ndarray]
    """Sensor name: (steps, m), before any attack."""
    channel: np.ndarray
    """(steps,) bool: the shared channel between the estimators delivers."""


@dataclass
class Play:
    """What the estimators of one run published."""

    errors: np.ndarray
    """(steps, nodes, n), estimate minus truth."""
    beliefs: list[list[Belief]] = field(repr=False)
    """By step, then node."""

    def alarms(self, node: int) -> np.ndarray:
        return np.array([any(d.alarm for d in row[node].detections) for row in self.beliefs])

    def covariances(self, node: int) -> np.ndarray:
        return np.array([row[node].covariance for row in self.beliefs])


@dataclass(frozen=True)
class Network:
    """Node i (from 1) is sensor ``s{i}`` and estimator ``e{i}``; h_ij = 1 / degree(i)."""

    plant: ConstantAcceleration
    sensors: Mapping[str, LinearSensor]
    neighbours: Mapping[str, Mapping[str, float]]

    def setting(self, index: int) -> Setting:
        name = f"e{index}"
        sensors = {f"s{index}": self.sensors[f"s{index}"]}
        return Setting(name, self.plant, sensors, self.neighbours[name], np.random.default_rng(0))

    def scenario(self, trial: int, steps: int = STEPS) -> Scenario:
        noise = random_stream(0, trial, "plant", "process_noise")
        states = [self.plant.initial_state(noise)]
        for step in range(1, steps):
            states.append(self.plant.advance(step, states[-1], noise))
        measurements = {}
        for name, sensor in self.sensors.items():
            rng = random_stream(0, trial, name, "noise")
            measurements[name] = np.array([sensor.observe(k, x, rng) for k, x in enumerate(states)])
        draws = random_stream(0, trial, "channel", "gilbert_elliott").random(steps)
        return Scenario(np.array(states), measurements, gilbert_elliott(draws))

    def play(
        self,
        scenario: Scenario,
        make: Make,
        attacks: Attacks | None = None,
        watch: Callable[[int, Sequence[Any]], None] | None = None,
    ) -> Play:
        """Run the estimators; ``watch`` sees them after the corrections and the exchange of each step."""
        names = sorted(self.neighbours, key=lambda name: int(name[1:]))
        estimators = [make(self.setting(int(name[1:]))) for name in names]
        measured = attacked(scenario.measurements, attacks or {})
        errors = np.empty((len(scenario.truth), len(names), len(self.plant.A)))
        beliefs = []
        for step, truth in enumerate(scenario.truth):
            outbox = {}
            for name, estimator in zip(names, estimators, strict=True):
                sensor = "s" + name[1:]
                packet = Packet(sensor, step, step, "measurement", measured[sensor][step])
                outbox[name] = Packet(name, step, step, "exchange", estimator.correct(step, [packet]))
            for name, estimator in zip(names, estimators, strict=True):
                delivered = scenario.channel[step] and estimator.rounds
                estimator.exchange(step, 0, [outbox[j] for j in self.neighbours[name]] if delivered else [])
            beliefs.append([estimator.estimate(step) for estimator in estimators])
            errors[step] = [belief.state - truth for belief in beliefs[-1]]
            if watch is not None:
                watch(step, estimators)
        return Play(errors, beliefs)


def gilbert_elliott(draws: np.ndarray) -> np.ndarray:
    """Return the states (steps,) of the channel, from the stationary law on; True delivers."""
    delivers = np.empty(len(draws), dtype=bool)
    delivers[0] = draws[0] < RECOVERY / (FAILURE + RECOVERY)
    for step in range(1, len(draws)):
        delivers[step] = draws[step] >= FAILURE if delivers[step - 1] else draws[step] < RECOVERY
    return delivers


def attacked(measurements: Mapping[str, np.ndarray], attacks: Attacks) -> dict[str, np.ndarray]:
    """Return the measurements with a bias on some sensors from the first to the last step of each attack."""
    result = {name: values.copy() for name, values in measurements.items()}
    for name, (bias, first, last) in attacks.items():
        result[name][first : last + 1] += bias
    return result


def ding_network(nodes: int = 20, radius: float = 0.35, graph_seed: int = GRAPH_SEED) -> Network:
    graph = nx.random_geometric_graph(nodes, radius, seed=graph_seed)
    assert nx.is_connected(graph)
    plant = ConstantAcceleration(
        PERIOD_S, process_noise=Gaussian(std=0.2), initial=Gaussian(std=float(np.sqrt(2.0)))
    )
    noise = Gaussian(std=0.05)
    sensors = {
        f"s{i}": LinearSensor(plant, C=[[4.5, -0.8, -0.5] if i < 8 else [4.0, -0.8, 1.0]], noise=noise)
        for i in range(1, nodes + 1)
    }
    neighbours = {
        f"e{i + 1}": {f"e{j + 1}": 1.0 / graph.degree[i] for j in sorted(graph[i])} for i in range(nodes)
    }
    return Network(plant, sensors, neighbours)


@pytest.fixture(scope="session")
def network() -> Network:
    """The 20 nodes of the paper on a pinned graph of largest degree 8."""
    return ding_network()


@pytest.fixture(scope="session")
def build_network() -> Callable[..., Network]:
    return ding_network
