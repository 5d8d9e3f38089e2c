"""Records by hand: a builder of plans and messages, and a network under attack made of random numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from bus import keys
from bus.messages import ChannelEvents, Estimate, Inbox, Message, Truth
from bus.plan import EstimatorPlan, Kind, LinkPlan, Plan, PlantPlan, SensorPlan, StagePlan, TimingPlan

PERIOD = 0.05


def make_plan(
    steps: int,
    estimators: Mapping[str, Sequence[str]],
    neighbours: Mapping[str, Sequence[str]] | None = None,
    method: str = "nodes.estimators.kalman:KalmanFilter",
    stages: Sequence[str] = ("bias",),
) -> Plan:
    """Return a plan whose estimators listen to the sensors given, and to their neighbours."""
    neighbours = neighbours or {}
    sensors = sorted({sensor for heard in estimators.values() for sensor in heard})
    heard = [(s, e, keys.MEASUREMENT) for e, names in estimators.items() for s in names]
    heard += [(j, e, keys.EXCHANGE) for e, names in neighbours.items() for j in names]
    return Plan(
        name="by-hand",
        seed=1,
        trial=0,
        steps=steps,
        period_s=PERIOD,
        plant=PlantPlan("plant", Kind("nodes.plants.linear:Linear")),
        sensors=tuple(SensorPlan(name, Kind("nodes.sensors.linear:Linear")) for name in sensors),
        estimators=tuple(
            EstimatorPlan(
                name,
                Kind(method),
                tuple(names),
                {other: 1.0 / len(neighbours[name]) for other in neighbours.get(name, ())},
                1 if neighbours else 0,
            )
            for name, names in estimators.items()
        ),
        stages=tuple(
            StagePlan(label, Kind("channel.attacks:Bias"), {}, label, TimingPlan(0, steps - 1))
            for label in stages
        ),
        links=tuple(LinkPlan(source, destination, stream, ()) for source, destination, stream in heard),
    )


@dataclass
class Recorder:
    """Collects the messages of a record; everything that is not given is empty."""

    records: list[tuple[str, Message]] = field(default_factory=list)

    def truth(self, step: int, state: Sequence[float], attack: Sequence[float] = ()) -> None:
        message = Truth(step=step, t=step * PERIOD, state=list(state), attack=list(attack))
        self.records.append((keys.truth("plant"), message))

    def estimate(
        self,
        node: str,
        step: int,
        state: Sequence[float],
        covariance: Sequence[float] = (),
        verdicts: Sequence[tuple[str, int, bool]] = (),
        *,
        refers_to: int | None = None,
        diverged: bool = False,
        nis: float = 0.0,
        nis_dof: int = 0,
        diagnostics: Mapping[str, float] | None = None,
    ) -> None:
        n = len(state) if covariance else 0
        message = Estimate(
            step=step,
            t=step * PERIOD,
            refers_to=step if refers_to is None else refers_to,
            diverged=diverged,
            state=list(state),
            covariance=list(covariance),
            covariance_shape=[n, n],
            sigma=[covariance[i * (n + 1)] ** 0.5 for i in range(n)],
            nis=nis,
            nis_dof=nis_dof,
            detector_source=[source for source, _, _ in verdicts],
            detector_sequence=[sequence for _, sequence, _ in verdicts],
            detector_statistic=[1.0 for _ in verdicts],
            detector_alarm=[alarm for _, _, alarm in verdicts],
            diagnostic_name=list(diagnostics or {}),
            diagnostic_value=list((diagnostics or {}).values()),
        )
        self.records.append((keys.estimate(node), message))

    def inbox(
        self, node: str, step: int, packets: Sequence[tuple[str, int]], phase: str = "measurement"
    ) -> None:
        message = Inbox(
            step=step,
            t=step * PERIOD,
            round=0,
            source=[source for source, _ in packets],
            sent_step=[step for _ in packets],
            sequence=[sequence for _, sequence in packets],
            kind=[phase for _ in packets],
            offset=list(range(len(packets))),
            values=[0.0 for _ in packets],
        )
        self.records.append((keys.rx(node, phase), message))

    def channel(
        self,
        step: int,
        counts: Mapping[str, tuple[int, int, int, int]] | None = None,
        events: Sequence[tuple[str, str, int, str]] = (),
        phase: str = "measurement",
    ) -> None:
        """Record (sent, lost, attacked, delivered) by link, and events (link, stage, sequence, action)."""
        counts = counts or {}
        message = ChannelEvents(
            step=step,
            t=step * PERIOD,
            round=0,
            link=list(counts),
            sent=[count[0] for count in counts.values()],
            lost=[count[1] for count in counts.values()],
            attacked=[count[2] for count in counts.values()],
            delivered=[count[3] for count in counts.values()],
            event_link=[event[0] for event in events],
            event_stage=[event[1] for event in events],
            event_sequence=[event[2] for event in events],
            event_action=[event[3] for event in events],
            event_magnitude=[0.0 if event[3] == "lost" else 15.0 for event in events],
        )
        self.records.append((keys.channel(phase), message))


@dataclass(frozen=True)
class Network:
    """A ring of estimators, each with its own sensor; estimates are the truth and random errors."""

    steps: int = 150
    nodes: int = 20
    seed: int = 0
    attacked: Mapping[str, tuple[int, int]] = field(default_factory=lambda: {"e4": (90, 95), "e12": (50, 55)})
    recall: float = 0.9
    false_alarms: float = 0.01
    deaf: Sequence[str] = ()
    diverging: Mapping[str, int] = field(default_factory=dict)
    error_scale: float = 1.0

    @property
    def names(self) -> list[str]:
        return [f"e{i}" for i in range(1, self.nodes + 1)]

    def plan(self) -> Plan:
        names = self.names
        ring = {e: sorted({names[i - 1], names[(i + 1) % len(names)]} - {e}) for i, e in enumerate(names)}
        return make_plan(
            self.steps,
            {e: [e.replace("e", "s")] for e in names},
            ring,
            "nodes.estimators.secure_distributed:SecureDistributedFilter",
        )

    def records(self) -> Iterator[tuple[str, Message]]:
        rng = np.random.default_rng(self.seed)
        plan = self.plan()
        truth = np.cumsum(rng.normal(0.0, 0.1, (self.steps, 3)), axis=0)
        for step in range(self.steps):
            recorder = Recorder()
            recorder.truth(step, truth[step].tolist())
            heard = self._measurements(recorder, step, rng)
            self._exchange(recorder, plan, step, rng)
            for name in self.names:
                self._estimate(recorder, name, step, truth[step], heard[name], rng)
            yield from recorder.records

    def _is_attacked(self, name: str, step: int) -> bool:
        return name in self.attacked and self.attacked[name][0] <= step <= self.attacked[name][1]

    def _measurements(
        self, recorder: Recorder, step: int, rng: np.random.Generator
    ) -> dict[str, list[tuple[str, int, bool]]]:
        heard: dict[str, list[tuple[str, int, bool]]] = {}
        events, counts = [], {}
        for name in self.names:
            sensor, attacked = name.replace("e", "s"), self._is_attacked(name, step)
            link = f"{sensor}->{name}"
            counts[link] = (1, 0, int(attacked), 1)
            if attacked:
                events.append((link, "bias", step, "attacked"))
            recorder.inbox(name, step, [(sensor, step)])
            deaf = name in self.deaf and step > self.attacked[name][1]
            alarm = deaf or rng.random() < (self.recall if attacked else self.false_alarms)
            heard[name] = [(sensor, step, bool(alarm))]
        recorder.channel(step, counts, events)
        return heard

    def _exchange(self, recorder: Recorder, plan: Plan, step: int, rng: np.random.Generator) -> None:
        events, counts = [], {}
        arrived: dict[str, list[tuple[str, int]]] = {name: [] for name in self.names}
        for link in plan.links_of(keys.EXCHANGE):
            lost = bool(rng.random() < 0.1)
            counts[link.name] = (1, int(lost), 0, int(not lost))
            if lost:
                events.append((link.name, "loss", step, "lost"))
            else:
                arrived[link.destination].append((link.source, step))
        for name, packets in arrived.items():
            recorder.inbox(name, step, packets, keys.EXCHANGE)
        recorder.channel(step, counts, events, keys.EXCHANGE)

    def _estimate(
        self,
        recorder: Recorder,
        name: str,
        step: int,
        truth: np.ndarray,
        verdicts: list[tuple[str, int, bool]],
        rng: np.random.Generator,
    ) -> None:
        error = self.error_scale * rng.normal(0.0, 0.2, 3) * (3.0 if self._is_attacked(name, step) else 1.0)
        nis = float(rng.chisquare(1))
        if name in self.diverging and step >= self.diverging[name]:
            recorder.estimate(name, step, [], diverged=True)
            return
        covariance = (0.04 * np.eye(3)).ravel().tolist()
        recorder.estimate(name, step, (truth + error).tolist(), covariance, verdicts, nis=nis, nis_dof=1)


@pytest.fixture(scope="session", name="make_plan")
def make_plan_fixture():
    return make_plan


@pytest.fixture(scope="session")
def make_recorder() -> type[Recorder]:
    return Recorder


@pytest.fixture
def recorder() -> Recorder:
    return Recorder()


@pytest.fixture(scope="session")
def make_network() -> type[Network]:
    return Network
