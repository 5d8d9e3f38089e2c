"""Event triggers in whole runs: what is quiet is no loss, and the score says how much was sent."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from bus.messages import ChannelEvents, Estimate, Message, Transmission
from bus.packets import Packet, Vector
from nodes.contract import Belief, Setting
from nodes.estimators.kalman import Kalman
from orchestrator.backends.inprocess import run_messages
from orchestrator.score.results import Score
from orchestrator.score.scoring import score
from orchestrator.topology.load import load_topology

TOPOLOGIES = sorted((Path(__file__).parents[2] / "topologies" / "triggers").glob("[a-z]*.yaml"))
Record = list[tuple[str, Message]]


def played(path: Path, overrides: Sequence[str] = ()) -> tuple[Record, Score]:
    topology = load_topology(path, overrides)
    record: Record = []
    run_messages(topology.plan, lambda topic, message: record.append((topic, message)))
    found = score(
        topology.plan,
        record,
        state_groups=topology.state_groups,
        options=topology.score_options,
        expectations=topology.expectations,
    )
    return record, found


@pytest.mark.parametrize("path", TOPOLOGIES, ids=lambda path: path.stem)
def test_every_example_keeps_what_it_promises(path: Path) -> None:
    _, found = played(path)
    assert found.passed, [outcome.message for outcome in found.expectations if not outcome.passed]


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
