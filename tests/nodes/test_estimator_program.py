from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from bus import keys
from bus.inprocess import CarryingBus
from bus.messages import Estimate, Message, encode
from bus.packets import ORACLE, Packet, inbox
from bus.plan import EstimatorPlan, Kind, Plan, PlantPlan
from bus.program import NodeError, run_alone
from nodes.contract import Belief, Detection
from nodes.estimator_program import estimator_program
from nodes.published import Published


class Scripted:
    """An estimator that returns what it is told to."""

    rounds = 0

    def __init__(self, belief: Belief, payload: Any = None) -> None:
        self._belief = belief
        self._payload = payload

    def correct(self, step: int, packets: Sequence[Packet]) -> Any:
        return self._payload

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Any:
        raise AssertionError("it has no exchange rounds")

    def estimate(self, step: int) -> Belief:
        return self._belief


class Port:
    def __init__(self) -> None:
        self.sent: list[Message] = []

    def send(self, topic: str, message: Message) -> None:
        assert topic == keys.estimate("e1")
        self.sent.append(message)


def play(estimator: Scripted, steps: int = 3) -> list[Estimate]:
    """Run the program of an estimator that listens to one silent sensor; return what it publishes."""
    own = EstimatorPlan("e1", Kind("unused:Unused"), ("s1",), {}, 0)
    plan = Plan("p", 0, 0, steps, 0.1, PlantPlan("plant", Kind("unused:Unused")), (), (own,), (), ())
    port = Port()
    inboxes = iter([inbox(step, 0.1 * step, 0, ()) for step in range(steps)])
    run_alone(estimator_program(port, plan, own, estimator, 2, 16), lambda topic: next(inboxes))
    return [message for message in port.sent if isinstance(message, Estimate)]


def test_a_belief_is_published_with_numbers_that_json_knows() -> None:
    detection = Detection("s1", 0, np.float32(2.5), np.bool_(True))  # type: ignore[arg-type]
    belief = Belief(
        np.array([1.0, 2.0]),
        np.diag([4.0, 9.0]),
        nis=np.float64(0.5),
        nis_dof=1,
        detections=[detection],
        diagnostics={"gain": np.float64(0.25)},
    )
    (first, *_) = play(Scripted(belief))
    assert (first.sigma, first.covariance_shape) == ([2.0, 3.0], [2, 2])
    assert b'"detector_alarm":[true]' in encode(first)
    assert b'"diagnostic_value":[0.25]' in encode(first)


class Reusing(Scripted):
    """An estimator that writes each belief over the one before."""

    def estimate(self, step: int) -> Belief:
        self._belief.state[:] = step
        self._belief.covariance[:] = step * np.eye(2)
        self._belief.diagnostics["gain"] = float(step)  # type: ignore[index]
        return self._belief


def test_what_is_carried_stays_when_an_estimator_reuses_its_arrays() -> None:
    kept: list[Published] = []
    own = EstimatorPlan("e1", Kind("unused:Unused"), ("s1",), {}, 0)
    plan = Plan("p", 0, 0, 3, 0.1, PlantPlan("plant", Kind("unused:Unused")), (), (own,), (), ())
    bus = CarryingBus(lambda topic, message: None, lambda topic: kept.append, ())
    estimator = Reusing(Belief(np.zeros(2), np.eye(2), diagnostics={}))
    bus.add(estimator_program(bus, plan, own, estimator, 2, 16), [keys.rx("e1", keys.CORRECT)])
    for step in range(3):
        bus.send(keys.rx("e1", keys.CORRECT), inbox(step, 0.1 * step, 0, ()))
    bus.run()
    assert [form.message() for form in kept] == play(Reusing(Belief(np.zeros(2), np.eye(2), diagnostics={})))
    assert [form.state.tolist() for form in kept] == [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", ["state", "covariance", "nis", "diagnostics"])
def test_no_number_that_is_not_finite_leaves_an_estimator(bad: float, where: str) -> None:
    parts: dict[str, Any] = {"state": np.zeros(2), "covariance": np.eye(2), "nis": 0.0, "diagnostics": {}}
    spoilt = {
        "state": np.array([0.0, bad]),
        "covariance": np.full((2, 2), bad),
        "nis": bad,
        "diagnostics": {"gain": bad},
    }
    messages = play(Scripted(Belief(**{**parts, where: spoilt[where]})))
    assert [message.diverged for message in messages] == [True] * 3
    assert all(message.state == [] and b"null" not in encode(message) for message in messages)


@pytest.mark.parametrize(
    ("state", "covariance"),
    [(np.zeros((1, 2)), np.eye(2)), (np.zeros(3), np.eye(3)), (np.zeros(2), np.ones(2))],
)
def test_a_belief_of_another_shape_is_refused_with_the_shapes(state: Any, covariance: Any) -> None:
    with pytest.raises(
        NodeError, match=r"e1 failed in step 0: ValueError: a belief has .* \(\(2,\), \(2, 2\)\)"
    ):
        play(Scripted(Belief(state, covariance)))


def test_a_payload_that_is_a_matrix_is_refused_with_the_cure() -> None:
    with pytest.raises(NodeError, match=r"a payload has one dimension, .* ravel it"):
        play(Scripted(Belief(np.zeros(2), np.eye(2)), payload=np.eye(2)))


class Listening(Scripted):
    """An estimator that notes what it is given."""

    def __init__(self) -> None:
        super().__init__(Belief(np.zeros(2), np.eye(2)))
        self.heard: list[str] = []

    def correct(self, step: int, packets: Sequence[Packet]) -> Any:
        self.heard += [packet.kind for packet in packets]
        return None


@pytest.mark.parametrize(("oracles", "heard", "refused"), [((), [], 1), (("bias",), [ORACLE], 0)])
def test_the_word_of_an_oracle_reaches_an_estimator_only_with_the_grant(
    oracles: tuple[str, ...], heard: list[str], refused: int
) -> None:
    own = EstimatorPlan("e1", Kind("unused:Unused"), ("s1",), {}, 0, oracles=oracles)
    plan = Plan("p", 0, 0, 1, 0.1, PlantPlan("plant", Kind("unused:Unused")), (), (own,), (), ())
    port, estimator = Port(), Listening()
    word = Packet("s1", 0, 0, ORACLE, np.ones(1))
    run_alone(estimator_program(port, plan, own, estimator, 2, 16), lambda topic: inbox(0, 0.0, 0, [word]))
    assert estimator.heard == heard
    (message,) = port.sent
    assert isinstance(message, Estimate)
    assert message.refused == refused
