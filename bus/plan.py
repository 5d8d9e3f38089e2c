"""A run, fully resolved: what every process is told of its own part, as plain picklable data.

The orchestrator makes a plan from a topology file; nodes and channel are built from it, in one process or in
many.
"""

from __future__ import annotations

import functools
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
    """The plant: there is one a run. ``controllers`` send it inputs."""

    name: str
    kind: Kind
    controllers: tuple[str, ...] = ()


@dataclass(frozen=True)
class SensorPlan:
    """A sensor node; ``send`` is the kind of its event trigger, None when it always sends."""

    name: str
    kind: Kind
    send: Kind | None = None


@dataclass(frozen=True)
class EstimatorPlan:
    """An estimator node: the sensors it hears, and its in-neighbours with their weights ``h_ij``, sorted.

    ``controllers`` tell it the inputs that they command. ``send`` is the kind of its event trigger, None when
    it always sends. ``oracles`` are the labels of the stages of which the channel tells it what they add to
    its measurements. ``stream`` names its random stream; its own name when empty.
    """

    name: str
    kind: Kind
    sensors: tuple[str, ...]
    neighbours: Mapping[str, float]
    rounds: int
    controllers: tuple[str, ...] = ()
    send: Kind | None = None
    oracles: tuple[str, ...] = ()
    stream: str = ""


@dataclass(frozen=True)
class ControllerPlan:
    """A controller node: it hears the estimate of one estimator and commands the plant's input."""

    name: str
    kind: Kind
    estimator: str


@dataclass(frozen=True)
class TimingPlan:
    """When something acts: in the steps from ``first`` to ``last``, both inclusive, where ``when`` agrees.

    ``when`` is the kind of a schedule (see `bus.schedules`), None for the whole window. It draws from the
    address (``stream``, ``purpose``). ``watches`` names the node of which it must be told, empty for none.
    """

    first: int
    last: int
    when: Kind | None = None
    stream: str = ""
    purpose: str = ""
    watches: str = ""


@dataclass(frozen=True)
class StagePlan:
    """One stage of the channel: one kind, over all the links it is declared for.

    ``label`` names it in the log. ``streams`` gives each link (by `LinkPlan.name`) the name of its random
    stream: links of one name share one chain and its draws. ``knowledge`` is what the topology grants it to
    know, as plain nested lists by name. ``holds_keys`` tells that it can seal packets in others' names.
    """

    label: str
    kind: Kind
    streams: Mapping[str, str]
    purpose: str
    timing: TimingPlan
    knowledge: Mapping[str, Any] = field(default_factory=dict)
    holds_keys: bool = False


@dataclass(frozen=True)
class SignalPlan:
    """A signal that enters the plant's dynamics and the sensors' measurements; see `nodes.signal_attack`."""

    label: str
    kind: Kind
    purpose: str
    timing: TimingPlan


@dataclass(frozen=True)
class FaultPlan:
    """The scheduled end of a node: from ``step`` on it is silent. A ``crash`` ends its process too."""

    node: str
    kind: str
    step: int


@dataclass(frozen=True)
class LinkPlan:
    """A directed link and the labels of its stages in the order in which they act.

    ``stream`` is `bus.keys.MEASUREMENT`, `bus.keys.EXCHANGE` or `bus.keys.CONTROL`.
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
    controllers: tuple[ControllerPlan, ...] = ()
    signals: tuple[SignalPlan, ...] = ()
    faults: tuple[FaultPlan, ...] = ()
    integrity: Mapping[str, str] = field(default_factory=dict)
    """How a sender seals its packets: ``crc`` or ``mac``, by node; a node that is not named does not."""

    def links_of(self, stream: str) -> tuple[LinkPlan, ...]:
        """Return the links that carry a stream, in the plan's order."""
        return tuple(link for link in self.links if link.stream == stream)

    @functools.cached_property
    def _senders(self) -> frozenset[tuple[str, str]]:
        return frozenset((link.source, link.stream) for link in self.links)

    def is_heard(self, node: str, stream: str) -> bool:
        """Return whether some link carries what a node sends on a stream."""
        return (node, stream) in self._senders

    @property
    def node_names(self) -> tuple[str, ...]:
        """The names of all nodes: plant, sensors, estimators, controllers."""
        return (
            self.plant.name,
            *(sensor.name for sensor in self.sensors),
            *(estimator.name for estimator in self.estimators),
            *(controller.name for controller in self.controllers),
        )

    @property
    def watched(self) -> tuple[str, ...]:
        """The nodes that triggers of the channel watch, sorted."""
        return tuple(sorted({stage.timing.watches for stage in self.stages if stage.timing.watches}))

    @property
    def triggered(self) -> tuple[str, ...]:
        """The nodes with an event trigger: sensors, then estimators."""
        sensors = tuple(sensor.name for sensor in self.sensors if sensor.send is not None)
        return sensors + tuple(own.name for own in self.estimators if own.send is not None)

    @functools.cached_property
    def _silent_from(self) -> dict[str, int]:
        silent: dict[str, int] = {}
        for fault in self.faults:
            silent[fault.node] = min(fault.step, silent.get(fault.node, self.steps))
        for controller in self.controllers:
            if controller.estimator in silent:
                own = silent.get(controller.name, self.steps)
                silent[controller.name] = min(own, silent[controller.estimator])
        return silent

    def silent_from(self, node: str) -> int:
        """Return the first step in which a node is silent; the number of steps when it never is.

        A controller says no more than the estimator that it hears.
        """
        return self._silent_from.get(node, self.steps)
