from __future__ import annotations

import random

import pytest

from bus.program import NodeError, Program, Scheduler, every_step


def test_a_program_gets_the_messages_of_the_topic_it_waits_for_in_order() -> None:
    seen: list[str] = []

    def program() -> Program:
        for topic in ("a", "b", "a"):
            message = yield topic
            seen.append(message)

    scheduler = Scheduler()
    scheduler.add(program(), ("a", "b"))
    scheduler.run()
    for topic, message in [("b", "b1"), ("a", "a1"), ("a", "a2")]:
        scheduler.deliver(topic, message)
    assert not scheduler.finished
    scheduler.run()
    assert seen == ["a1", "b1", "a2"]
    assert scheduler.finished


def test_a_message_that_came_before_the_first_run_is_not_lost() -> None:
    def program() -> Program:
        yield "a"

    scheduler = Scheduler()
    scheduler.add(program(), ("a",))
    scheduler.deliver("a", 1)
    scheduler.run()
    assert scheduler.finished


@pytest.mark.parametrize("seed", range(20))
def test_what_programs_compute_does_not_depend_on_the_order_of_arrival(seed: int) -> None:
    scheduler = Scheduler()
    sums: list[int] = []

    def adder(left: str, right: str) -> Program:
        for _ in range(10):
            first = yield left
            second = yield right
            sums.append(100 * first + second)

    scheduler.add(adder("a", "b"), ("a", "b"))
    order = random.Random(seed)
    scheduler.run()
    queues = {"a": list(range(10)), "b": list(range(10))}
    while any(queues.values()):
        topic = order.choice([topic for topic, left in queues.items() if left])
        scheduler.deliver(topic, queues[topic].pop(0))
        scheduler.run()
    assert sums == [101 * k for k in range(10)]


def test_what_a_node_raises_names_the_node_and_the_step() -> None:
    def one_step(step: int) -> Program:
        yield "a"
        if step == 2:
            raise ZeroDivisionError("no gain")

    scheduler = Scheduler()
    scheduler.add(every_step("e7", 5, one_step), ("a",))
    scheduler.run()
    for _ in range(3):
        scheduler.deliver("a", None)
    with pytest.raises(NodeError, match="e7 failed in step 2: ZeroDivisionError: no gain") as caught:
        scheduler.run()
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
