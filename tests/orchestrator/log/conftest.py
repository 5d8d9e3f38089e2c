"""A small plan (three sensors, three estimators in a ring), its messages, and logs of it."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from bus import keys
from bus.messages import ChannelEvents, Estimate, Inbox, Message, Transmission, Truth, encode
from bus.plan import EstimatorPlan, Kind, LinkPlan, Plan, PlantPlan, SensorPlan
from orchestrator.log.order import Slot, canonical_order, canonical_topics
from orchestrator.log.provenance import provenance
from orchestrator.log.recorder import Recorder
from orchestrator.log.writer import CHUNK_STEPS, LogWriter


def ring_plan(steps: int = 6, rounds: int = 2) -> Plan:
    """Return three sensors, each heard by its estimator, and three estimators in a directed ring."""
    kind = Kind("nowhere:Nothing")
    before = {"e1": "e3", "e2": "e1", "e3": "e2"}
    return Plan(
        name="ring",
        seed=7,
        trial=0,
        steps=steps,
        period_s=0.05,
        plant=PlantPlan("plant", kind),
        sensors=tuple(SensorPlan(f"s{i}", kind) for i in (1, 2, 3)),
        estimators=tuple(
            EstimatorPlan(name, kind, (f"s{name[1:]}",), {before[name]: 1.0}, rounds) for name in before
        ),
        stages=(),
        links=(
            *(LinkPlan(f"s{i}", f"e{i}", keys.MEASUREMENT, ()) for i in (1, 2, 3)),
            *(LinkPlan(source, receiver, keys.EXCHANGE, ()) for receiver, source in before.items()),
        ),
    )


def _message(slot: Slot, step: int, rng: random.Random) -> Message:
    """Return a plausible message of a slot: of its type, with random numbers in it."""
    t = step * 0.05
    values = [rng.gauss(0, 1) for _ in range(3)]
    kind, node = slot.topic.split("/")[:2]
    if kind == "truth":
        return Truth(step=step, t=t, state=values)
    if kind == "tx":
        return Transmission(step=step, t=t, round=slot.round, sequence=[step], offset=[0], values=values)
    if kind == "rx":
        return Inbox(
            step=step,
            t=t,
            round=slot.round,
            source=[f"s{node[1:]}"],
            sent_step=[step],
            sequence=[step],
            kind=[keys.MEASUREMENT],
            offset=[0],
            values=values,
        )
    if kind == "channel":
        return ChannelEvents(
            step=step,
            t=t,
            round=slot.round,
            link=["s1->e1", "s2->e2"],
            sent=[1, 1],
            lost=[0, 1],
            attacked=[1, 0],
            delivered=[1, 0],
            event_link=["s1->e1", "s2->e2"],
            event_stage=["bias", "bernoulli"],
            event_sequence=[step, step],
            event_action=["attacked", "lost"],
            event_magnitude=[1.5, 0.0],
        )
    return Estimate(
        step=step,
        t=t,
        refers_to=step,
        diverged=False,
        state=values,
        covariance=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        covariance_shape=[3, 3],
        sigma=[1.0, 1.0, 1.0],
        nis=0.5,
        nis_dof=1,
        detector_source=["s1"],
        detector_sequence=[step],
        detector_statistic=[0.25],
        detector_alarm=[False],
        diagnostic_name=["gain"],
        diagnostic_value=[0.125],
    )


Traffic = list[tuple[str, int, int, bytes]]


class Ring:
    """Makes plans, their traffic, and logs of it."""

    plan = staticmethod(ring_plan)

    def traffic(self, plan: Plan) -> Traffic:
        """Return every (topic, round, step, payload) of a run of the plan, in canonical order."""
        rng = random.Random(plan.seed)
        return [
            (slot.topic, slot.round, step, encode(_message(slot, step, rng)))
            for step in range(plan.steps)
            for slot in canonical_order(plan)
        ]

    def writer(self, path: Path, plan: Plan) -> LogWriter:
        """Open a log of the plan."""
        facts = provenance(plan, "0123abcd")
        return LogWriter(path, facts, b'{"name":"ring"}', canonical_topics(plan))

    def write(self, path: Path, plan: Plan, traffic: Traffic) -> Path:
        """Record the traffic, in the order given, into a finished log."""
        with self.writer(path, plan) as writer:
            recorder = Recorder(plan, writer, window=plan.steps)
            for message in traffic:
                recorder.store(*message)
            recorder.write_partial_steps()
            writer.finish(recorder.outcome(), b'{"rmse":0.5}')
        return path


@pytest.fixture(scope="session")
def ring() -> Ring:
    return Ring()


@pytest.fixture(scope="session")
def plan(ring: Ring) -> Plan:
    return ring.plan()


@pytest.fixture(scope="session")
def traffic(ring: Ring, plan: Plan) -> Traffic:
    return ring.traffic(plan)


@pytest.fixture(scope="session")
def log_path(ring: Ring, plan: Plan, traffic: Traffic, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole log of the plan, to be read only."""
    return ring.write(tmp_path_factory.mktemp("logs") / "run.mcap", plan, traffic)


@pytest.fixture(scope="session")
def long_log(ring: Ring, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole log of three chunks, the last one half full, to be read only."""
    plan = ring.plan(steps=5 * CHUNK_STEPS // 2, rounds=0)
    return ring.write(tmp_path_factory.mktemp("logs") / "long.mcap", plan, ring.traffic(plan))
