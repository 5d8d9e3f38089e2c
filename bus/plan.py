"""A run, fully resolved: what every process is told of its own part, as plain picklable data.

The orchestrator makes a plan from a topology file; nodes and channel are built from it, in one process or in
many.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Kind:
    """A kind and its parameters: ``reference`` is ``module:Class`` or ``/path/to/file.py:Class``."""

    reference: str
    parameters: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class PlantPlan:
    """The plant: there is one a run."""

    name: str
    kind: Kind


@dataclass(frozen=True)
class SensorPlan:
    """A sensor node."""

    name: str
    kind: Kind


@dataclass(frozen=True)
class EstimatorPlan:
    """An estimator node: the sensors it hears, and its in-neighbours with their weights ``h_ij``, sorted."""

    name: str
    kind: Kind
    sensors: tuple[str, ...]
    neighbours: Mapping[str, float]
    rounds: int


@dataclass(frozen=True)
class StagePlan:
    """One stage of the channel: one kind, over all the links it is declared for.

    ``label`` names it in the log. ``streams`` gives each link (by `LinkPlan.name`) the name of its random
    stream: links of one name share one chain and its draws. ``first`` and ``last`` bound the steps, both
    inclusive, in which it acts.
    """

    label: str
    kind: Kind
    streams: Mapping[str, str]
    purpose: str
    first: int
    last: int


@dataclass(frozen=True)
class LinkPlan:
    """A directed link and the labels of its stages in the order in which they act.

    ``stream`` is `bus.keys.MEASUREMENT` or `bus.keys.EXCHANGE`.
    """

    source: str
    destination: str
    stream: str
    stages: tuple[str, ...]

    @property
    def name(self) -> str:
        """The link as people write it: ``s4->e4``."""
        return f"{self.source}->{self.destination}"


@dataclass(frozen=True)
class Plan:
    """A whole run. Times are ``t = step * period_s``; steps run from 0 to ``steps - 1``."""

    name: str
    seed: int
    trial: int
    steps: int
    period_s: float
    plant: PlantPlan
    sensors: tuple[SensorPlan, ...]
    estimators: tuple[EstimatorPlan, ...]
    stages: tuple[StagePlan, ...]
    links: tuple[LinkPlan, ...]

    def links_of(self, stream: str) -> tuple[LinkPlan, ...]:
        """Return the links that carry a stream, in the plan's order."""
        return tuple(link for link in self.links if link.stream == stream)

    @property
    def node_names(self) -> tuple[str, ...]:
        """The names of all nodes: plant, sensors, estimators."""
        return (
            self.plant.name,
            *(sensor.name for sensor in self.sensors),
            *(estimator.name for estimator in self.estimators),
        )
