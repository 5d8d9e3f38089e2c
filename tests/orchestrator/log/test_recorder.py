from __future__ import annotations

import random
from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus.plan import Plan
from orchestrator.log.errors import LogError
from orchestrator.log.order import canonical_order
from orchestrator.log.recorder import OTHER, Recorder


class Memory:
    """A step writer that keeps what it is given."""

    def __init__(self) -> None:
        self.steps: list[int] = []
        self.messages: list[tuple[str, bytes]] = []

    def write_step(self, step: int, messages: Iterable[tuple[str, bytes]]) -> None:
        self.steps.append(step)
        self.messages += messages


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_messages_in_any_order_are_written_in_the_canonical_one(
    plan: Plan, traffic: list[Any], seed: int
) -> None:
    memory = Memory()
    recorder = Recorder(plan, memory, window=plan.steps)
    for message in random.Random(seed).sample(traffic, len(traffic)):
        recorder.store(*message)
    assert recorder.complete
    assert memory.steps == list(range(plan.steps))
    assert memory.messages == [(topic, payload) for topic, _, _, payload in traffic]


def test_a_step_is_written_as_soon_as_it_and_all_before_it_are_whole(plan: Plan, traffic: list[Any]) -> None:
    memory = Memory()
    recorder = Recorder(plan, memory, window=2)
    size = len(canonical_order(plan))
    first, rest = traffic[0], traffic[1 : 2 * size]
    assert {recorder.store(*message) for message in rest} == {0}
    assert not memory.steps
    assert recorder.store(*first) == 2
    assert memory.steps == [0, 1]


def test_a_duplicate_is_counted_and_changes_nothing(plan: Plan, traffic: list[Any]) -> None:
    memory = Memory()
    recorder = Recorder(plan, memory, window=1)
    recorder.store(*traffic[0])
    recorder.store(*traffic[0][:3], b"another")
    for message in traffic[1:]:
        recorder.store(*message)
    recorder.store(*traffic[0])
    assert recorder.rejected == {"truth/plant": 2}
    assert memory.messages[0] == (traffic[0][0], traffic[0][3])
    assert recorder.complete


@pytest.mark.parametrize(
    ("topic", "round_", "step"),
    [
        ("estimate/e9", 0, 0),
        ("tx/e1/exchange", 2, 0),
        ("truth/plant", 1, 0),
        ("truth/plant", 0, -1),
        ("truth/plant", 0, 6),
    ],
)
def test_what_the_plan_does_not_expect_is_counted_and_not_stored(
    plan: Plan, topic: str, round_: int, step: int
) -> None:
    recorder = Recorder(plan, Memory(), window=10)
    assert recorder.store(topic, round_, step, b"{}") == 0
    assert recorder.rejected == {topic: 1}
    assert recorder.missing() == canonical_order(plan)


def test_names_made_up_without_end_are_counted_together(plan: Plan) -> None:
    recorder = Recorder(plan, Memory(), window=1)
    for number in range(2000):
        recorder.store(f"estimate/x{number}", 0, 0, b"{}")
    assert len(recorder.rejected) == 1001
    assert recorder.rejected[OTHER] == 1000


def test_a_step_beyond_the_window_is_refused(plan: Plan) -> None:
    recorder = Recorder(plan, Memory(), window=2)
    recorder.store("truth/plant", 0, 2, b"{}")
    with pytest.raises(LogError, match="truth/plant is at step 3 while step 0 is not whole"):
        recorder.store("truth/plant", 0, 3, b"{}")


def test_missing_tells_what_the_lowest_incomplete_step_lacks(plan: Plan, traffic: list[Any]) -> None:
    recorder = Recorder(plan, Memory(), window=1)
    for message in traffic:
        if message[0] != "rx/e2/correct" or message[2] == 0:
            if message[2] > 2:
                break
            recorder.store(*message)
    assert recorder.steps_recorded == 1
    assert recorder.missing() == (("rx/e2/correct", 0),)


def test_nothing_is_missing_at_the_end(plan: Plan, traffic: list[Any]) -> None:
    recorder = Recorder(plan, Memory(), window=1)
    for message in traffic:
        recorder.store(*message)
    assert recorder.missing() == ()
    assert recorder.outcome() == {"complete": "true", "steps_recorded": "6"}


def test_an_aborted_run_keeps_what_came_of_open_steps_in_canonical_order(
    plan: Plan, traffic: list[Any]
) -> None:
    memory = Memory()
    recorder = Recorder(plan, memory, window=3)
    size = len(canonical_order(plan))
    kept = [*traffic[:size], *traffic[size + 2 : size + 5], *traffic[2 * size : 2 * size + 4]]
    for message in reversed(kept):
        recorder.store(*message)
    recorder.write_partial_steps()
    assert memory.steps == [0, 1, 2]
    assert memory.messages == [(topic, payload) for topic, _, _, payload in kept]
    assert recorder.outcome() == {"complete": "false", "steps_recorded": "1"}


@pytest.mark.parametrize("last", [0, 2])
def test_a_node_that_is_no_more_expected_leaves_whole_steps(
    plan: Plan, traffic: list[Any], last: int
) -> None:
    node = plan.sensors[0].name
    topic = f"tx/{node}/measurement"
    memory = Memory()
    recorder = Recorder(plan, memory, window=plan.steps)
    for message in traffic:
        if message[0] != topic or message[2] < last:
            recorder.store(*message)
    assert recorder.steps_recorded == last
    lacking = recorder.expect_no_more_of(node)
    assert {slot.topic: step for slot, step in lacking.items()} == {topic: last}
    assert recorder.complete
    assert not recorder.missing()
    assert recorder.outcome()[f"departed.{node}"] == str(last)
    expected = [(m[0], m[3]) for m in traffic if m[0] != topic or m[2] < last]
    assert memory.messages == expected


def test_a_node_is_no_more_expected_in_steps_that_begin_later(plan: Plan, traffic: list[Any]) -> None:
    node = plan.sensors[0].name
    memory = Memory()
    recorder = Recorder(plan, memory, window=plan.steps)
    recorder.expect_no_more_of(node)
    for message in traffic:
        if not message[0].startswith(f"tx/{node}/"):
            recorder.store(*message)
    assert recorder.complete
    assert recorder.departed == {node: 0}
