"""Event triggers in whole runs: what is quiet is no loss, and the score says how much was sent."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from bus.messages import ChannelEvents, Estimate, Transmission
from bus.packets import Packet, Vector
from nodes.contract import Belief, Setting
from nodes.estimators.kalman import Kalman
from orchestrator.run import run_topology
from orchestrator.score.results import Score
from orchestrator.topology.load import load_topology
from tests.playing import Record, assert_keeps_what_it_expects, record_of, scored

TOPOLOGIES = sorted((Path(__file__).parents[2] / "topologies" / "triggers").glob("[a-z]*.yaml"))


def played(path: Path, overrides: Sequence[str] = ()) -> tuple[Record, Score]:
    topology = load_topology(path, overrides)
    record = record_of(topology)
    return record, scored(topology, record)


@pytest.mark.parametrize("path", TOPOLOGIES, ids=lambda path: path.stem)
def test_every_example_keeps_what_it_promises(path: Path) -> None:
    _, found = played(path)
    assert_keeps_what_it_expects(found)


def test_the_rate_is_the_share_of_slots_that_were_filled(tmp_path: Path) -> None:
    path = next(path for path in TOPOLOGIES if path.stem == "send_on_delta")
    record, found = played(path)
    for sender in found.senders:
        slots = [m for topic, m in record if topic.startswith(f"tx/{sender.name}/")]
        assert all(isinstance(message, Transmission) for message in slots)
        filled = sum(bool(message.sequence) for message in slots)  # type: ignore[attr-defined]
        assert (sender.slots, sender.sent) == (len(slots), filled)
        assert sender.rate == filled / len(slots)
        assert 0 < filled < len(slots)


def test_a_trigger_moves_nobodys_draws() -> None:
    """What a sensor sends is what it would have sent then without a trigger, whatever the trigger draws."""
    path = next(path for path in TOPOLOGIES if path.stem == "stochastic_innovation")
    values = []
    for overrides in ((), ("sensors.s*.send=null", "expect=null")):
        record, _ = played(path, overrides)
        slots = {(t, m.step): m.values for t, m in record if isinstance(m, Transmission) and m.sequence}
        values.append(slots)
    sent, whole = values
    assert len(whole) == 1200
    assert 0 < len(sent) < 600
    assert all(whole[slot] == numbers for slot, numbers in sent.items())


def test_the_rate_from_a_log_is_that_from_memory(tmp_path: Path) -> None:
    path = next(path for path in TOPOLOGIES if path.stem == "network")
    report = run_topology(load_topology(path, ["steps=30"]), tmp_path, "inprocess", lambda step: None)
    _, found = played(path, ["steps=30"])
    assert report.score.senders == found.senders
    assert len(found.senders) == 8


def test_a_quiet_slot_is_no_loss(tmp_path: Path) -> None:
    record, found = played(TOPOLOGIES[0])
    events = [message for _, message in record if isinstance(message, ChannelEvents)]
    assert sum(sum(message.sent) for message in events) == found.traffic.sent < 1200
    assert found.traffic.lost == 0
    assert found.traffic.delivered == found.traffic.sent


def test_estimators_and_silent_nodes_have_rates_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "network.yaml"
    path.write_text(
        """
period_s: 0.1
steps: 60
plant: {model: linear, A: [[0.9]], process_noise: {std: 0.1}, initial: {std: 1.0}}
sensors: {s1..s3: {model: linear, C: [[1.0]], noise: {std: 0.3}}}
estimators: {e1..e3: {method: secure_distributed, coupling: 0.01, send: {periodic: {every: 3}}}}
graph: {ring: {nodes: 3}}
attacks: [{crash: {}, on: e3, steps: [30, 59]}]
expect:
  sent_rate: [{equals: 0.3333333333333333}, {node: e1..e3, equals: 0.3333333333333333}]
"""
    )
    _, found = played(path)
    assert [(sender.name, sender.slots) for sender in found.senders] == [("e1", 60), ("e2", 60), ("e3", 30)]
    assert found.passed


class FillsItsSlots(Kalman):
    """A method that asks its trigger itself: it always sends its state, and says when that counts."""

    takes_trigger = True

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.rounds = 1
        self._trigger = setting.trigger
        self._sent = True

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        super().correct(step, packets)
        self._sent = self._trigger is None or self._trigger.sends(step, self._state, 0.1 * self._state)
        return np.append(self._state, float(self._sent))

    def estimate(self, step: int) -> Belief:
        belief = super().estimate(step)
        return Belief(belief.state, belief.covariance, diagnostics={"sent": float(self._sent)})


def test_a_method_that_asks_its_trigger_itself_may_fill_its_slots(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(
        f"""
period_s: 0.1
steps: 60
plant: {{model: linear, A: [[0.95]], process_noise: {{std: 0.1}}, initial: {{std: 1.0}}}}
sensors: {{s1..s2: {{model: linear, C: [[1.0]], noise: {{std: 0.3}}}}}}
estimators:
  e1..e2: {{method: '{__file__}:FillsItsSlots', send: {{relative: {{sigma: 20.0}}}}}}
graph: {{edges: [[e1, e2]]}}
"""
    )
    record, found = played(path)
    said = [m.diagnostic_value[0] for topic, m in record if isinstance(m, Estimate) and topic.endswith("e1")]
    assert found.traffic.lost == 0
    assert all(link.traffic.sent == 60 for link in found.links)
    assert found.senders[0].rate == sum(said) / 60
    assert 0.0 < sum(said) < 60


@pytest.mark.parametrize(
    ("stem", "parameter", "values"),
    [
        ("send_on_delta", "send_on_delta.threshold", (0.25, 0.75, 1.5)),
        ("deterministic_innovation", "deterministic_innovation.threshold", (0.5, 1.3, 2.2)),
        ("stochastic_innovation", "stochastic_innovation.Y", (40.0, 7.0, 1.0)),
    ],
)
def test_the_less_is_sent_the_larger_the_error(stem: str, parameter: str, values: Sequence[float]) -> None:
    path = next(path for path in TOPOLOGIES if path.stem == stem)
    rates, errors = [], []
    for value in values:
        _, found = played(path, [f"sensors.s*.send.{parameter}={value}", "expect=null"])
        rates.append(sum(sender.sent for sender in found.senders))
        errors.append(sum(node.groups["position"].rmse or np.inf for node in found.nodes))
    assert rates == sorted(rates, reverse=True)
    assert errors == sorted(errors)
    assert rates[0] > 5.0 * rates[-1]
    assert errors[-1] > 1.3 * errors[0]
