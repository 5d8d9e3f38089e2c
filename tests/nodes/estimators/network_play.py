"""A small network of sensors and filters, driven by direct calls: no bus, no channel process."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import networkx as nx
import numpy as np

from bus.packets import Packet
from nodes.contract import Belief, Plant, Sensor, Setting
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.sensors.linear import Linear as LinearSensor

Delivers = Callable[[int, int, str, str], bool]
"""Whether the packet of a step and round gets from one node to another."""


@dataclass(frozen=True)
class Network:
    """Node ``e{i}`` hears sensor ``s{i}`` and its neighbours, with Metropolis weights."""

    plant: Plant
    sensors: Mapping[str, Sensor]
    graph: nx.Graph

    @property
    def names(self) -> list[str]:
        return [f"e{i}" for i in sorted(self.graph)]

    def setting(self, name: str, neighbours: bool = True) -> Setting:
        i = int(name[1:])
        degree = self.graph.degree
        weights = {f"e{j}": 1.0 / (1 + max(degree[i], degree[j])) for j in sorted(self.graph[i])}
        sensor = {f"s{i}": self.sensors[f"s{i}"]}
        return Setting(name, self.plant, sensor, weights if neighbours else {}, np.random.default_rng(0))

    def hearing(self, *sensors: str) -> Setting:
        """Return the setting of a filter that hears the sensors named, or all, and no neighbour."""
        heard = {name: self.sensors[name] for name in sensors or self.sensors}
        return Setting("k1", self.plant, heard, {}, np.random.default_rng(0))

    def neighbourhood(self, name: str) -> list[str]:
        i = int(name[1:])
        return [f"s{j}" for j in sorted([i, *self.graph[i]])]

    def trial(self, seed: int, steps: int) -> tuple[np.ndarray, list[list[Packet]]]:
        """Return the states (steps, n) and the packets of all sensors in each step."""
        rng = np.random.default_rng(seed)
        states = [self.plant.initial_state(rng)]
        for step in range(1, steps):
            states.append(self.plant.advance(step, states[-1], rng))
        packets = [
            [
                Packet(name, step, step, "measurement", sensor.observe(step, state, rng))
                for name, sensor in self.sensors.items()
            ]
            for step, state in enumerate(states)
        ]
        return np.array(states), packets

    def play(
        self,
        make: Callable[[Setting], Any],
        packets: Sequence[Sequence[Packet]],
        delivers: Delivers = lambda step, round_, source, destination: True,
    ) -> list[list[Belief]]:
        """Return what the filters of all nodes believe, by step, then node."""
        nodes = {name: make(self.setting(name)) for name in self.names}
        beliefs = []
        for step, row in enumerate(packets):
            payloads = {
                name: node.correct(step, [p for p in row if p.source[1:] == name[1:]])
                for name, node in nodes.items()
            }
            for round_ in range(max(node.rounds for node in nodes.values())):
                payloads = {
                    name: node.exchange(step, round_, self._arrivals(name, step, round_, payloads, delivers))
                    for name, node in nodes.items()
                }
            beliefs.append([node.estimate(step) for node in nodes.values()])
        return beliefs

    def _arrivals(
        self, name: str, step: int, round_: int, payloads: Mapping[str, Any], delivers: Delivers
    ) -> list[Packet]:
        return [
            Packet(f"e{j}", step, step, "exchange", payloads[f"e{j}"])
            for j in sorted(self.graph[int(name[1:])])
            if delivers(step, round_, f"e{j}", name)
        ]


def small_network(graph: nx.Graph) -> Network:
    """Sensors of unlike outputs and noises on a damped rotation; none alone sees the whole state well."""
    plant = LinearPlant(
        0.1,
        A=[[0.95, 0.2, 0.0], [-0.2, 0.95, 0.1], [0.0, 0.0, 0.9]],
        process_noise=Gaussian(std=[0.1, 0.1, 0.2]),
        initial=Gaussian(std=[1.0, 1.5, 0.7], mean=[1.0, -1.0, 0.5]),
    )
    rows = ([[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]], [[0.5, 0.0, 1.0], [0.0, 0.3, 0.3]])
    sensors = {
        f"s{i}": LinearSensor(plant, C=rows[i % 3], noise=Gaussian(std=0.2 + 0.1 * i)) for i in sorted(graph)
    }
    return Network(plant, sensors, graph)


def ring(nodes: int = 5) -> Network:
    return small_network(nx.relabel_nodes(nx.cycle_graph(nodes), lambda i: i + 1))


def complete(nodes: int = 5) -> Network:
    return small_network(nx.relabel_nodes(nx.complete_graph(nodes), lambda i: i + 1))


def alone(estimator: Any, packets: Sequence[Sequence[Packet]]) -> list[Belief]:
    """Return the beliefs of a filter without neighbours."""
    heard = []
    for step, row in enumerate(packets):
        estimator.correct(step, row)
        heard.append(estimator.estimate(step))
    return heard


def assert_equal_beliefs(belief: Belief, other: Belief, atol: float = 1e-9) -> None:
    np.testing.assert_allclose(belief.state, other.state, rtol=0.0, atol=atol)
    np.testing.assert_allclose(belief.covariance, other.covariance, rtol=0.0, atol=atol)


def errors_and_nees(
    network: Network, make: Callable[[Setting], Any], runs: int, steps: int, loss: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the last step's errors (runs, N, n), NEES (runs, N) and covariances (runs, N, n, n)."""
    errors, nees, covariances = [], [], []
    for run in range(runs):
        states, packets = network.trial(5000 + run, steps)
        rng = np.random.default_rng(run)
        beliefs = network.play(make, packets, lambda *_: bool(rng.random() >= loss))[-1]  # noqa: B023
        error = np.array([belief.state - states[-1] for belief in beliefs])
        P = np.array([belief.covariance for belief in beliefs])
        errors.append(error)
        covariances.append(P)
        nees.append([float(e @ np.linalg.solve(p, e)) for e, p in zip(error, P, strict=True)])
    return np.array(errors), np.array(nees), np.array(covariances)
