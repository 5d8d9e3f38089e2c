"""When something acts: windows, chance, and triggers that act at least one step late."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, norm

from bus.plan import Kind, Plan, PlantPlan, TimingPlan
from bus.random_streams import random_stream
from bus.schedules import Alarm, BernoulliSchedule, MarkovSchedule, Periodic, StateCrosses, Timing

FALSE_ALARM = 1e-6
"""Of each random test: over its independent runs, by the law that it names."""


def steps_of(schedule: Periodic | StateCrosses | Alarm, steps: int) -> list[int]:
    return [step for step in range(steps) if schedule.active(step)]


def generator(number: int = 0) -> np.random.Generator:
    return random_stream(7, number, "attack", "when")


def test_a_period_begins_at_its_offset_and_acts_for_its_first_steps() -> None:
    periodic = Periodic(generator(), every=5, steps_on=2, offset=3)
    assert steps_of(periodic, 15) == [3, 4, 8, 9, 13, 14]
    with pytest.raises(ValueError, match="more than the period"):
        Periodic(generator(), every=2, steps_on=3)


def test_chance_acts_with_its_probability_whoever_asks_first() -> None:
    """The number of active steps over independent streams is binomial."""
    runs, steps, probability = 20, 1000, 0.3
    schedules = [BernoulliSchedule(generator(run), probability=probability) for run in range(runs)]
    active = sum(schedule.active(step) for schedule in schedules for step in reversed(range(steps)))
    low, high = binom.interval(1.0 - FALSE_ALARM, runs * steps, probability)
    assert low <= active <= high
    again = BernoulliSchedule(generator(3), probability=probability)
    assert [again.active(step) for step in range(steps)] == [
        schedules[3].active(step) for step in range(steps)
    ]


def test_a_chain_of_two_states_has_its_stationary_share_and_geometric_spells() -> None:
    """One state a run, drawn from the stationary law, is binomial over runs; so are the switches."""
    runs, start, stop = 4000, 0.1, 0.4
    chains = [
        MarkovSchedule(generator(run), start=start, stop=stop, initial="stationary") for run in range(runs)
    ]
    on = [chain.active(0) for chain in chains]
    low, high = binom.interval(1.0 - FALSE_ALARM, runs, start / (start + stop))
    assert low <= sum(on) <= high
    ended = [not chain.active(1) for chain, was_on in zip(chains, on, strict=True) if was_on]
    low, high = binom.interval(1.0 - FALSE_ALARM, len(ended), stop)
    assert low <= sum(ended) <= high


@pytest.mark.parametrize(
    ("direction", "hold", "once", "expected"),
    [
        ("up", 2, False, [2, 3, 6, 7]),
        ("down", 2, False, [4, 5]),
        ("any", 1, False, [2, 4, 6]),
        ("up", 0, False, [2, 3, 4, 5, 6, 7, 8]),
        ("up", 1, True, [2]),
    ],
)
def test_a_crossing_acts_from_the_next_step_on(
    direction: str, hold: int, once: bool, expected: list[int]
) -> None:
    trigger = StateCrosses(
        generator(),
        component=0,
        value=1.0,
        direction=direction,
        hold=hold,
        once=once,  # type: ignore[arg-type]
    )
    active = []
    for step, value in enumerate([0.0, 1.0, 2.0, 0.5, 0.0, 3.0, 3.0, 3.0, 3.0]):
        if trigger.active(step):
            active.append(step)
        trigger.note(step, [value])
        trigger.note(step, [value])
    assert active == expected


def test_a_component_that_the_state_does_not_have_is_refused() -> None:
    trigger = StateCrosses(generator(), component=2, value=1.0)
    with pytest.raises(ValueError, match="component 2 is not in a state of 1"):
        trigger.note(0, [0.0])


@given(st.lists(st.booleans(), min_size=1, max_size=30), st.integers(1, 3), st.integers(0, 3))
def test_an_alarm_is_answered_after_its_delay_for_as_long_as_told(
    alarms: list[bool], delay: int, hold: int
) -> None:
    answer, shy = (
        Alarm(generator(), of="e1", delay=delay, hold=hold),
        Alarm(generator(), of="e1", delay=delay, hold=hold, invert=True),
    )
    for step, alarm in enumerate(alarms):
        causes = [cause + delay for cause, raised in enumerate(alarms[:step]) if raised]
        expected = any(first <= step and (not hold or step < first + hold) for first in causes)
        assert answer.active(step) is expected
        assert shy.active(step) is not expected
        for trigger in (answer, shy):
            trigger.note(step, [float(alarm)])


def test_a_schedule_acts_only_inside_its_window() -> None:
    plan = Plan("p", 1, 0, 20, 0.1, PlantPlan("plant", Kind("nowhere:Nothing")), (), (), (), ())
    every_other = Kind("bus.schedules:Periodic", {"every": 2})
    timing = Timing(plan, TimingPlan(3, 8, every_other, "attack", "when"))
    assert [step for step in range(20) if timing.active(step)] == [4, 6, 8]
    assert [step for step in range(20) if Timing(plan, TimingPlan(3, 5)).active(step)] == [3, 4, 5]


def test_crossings_of_a_random_walk_come_when_theory_says() -> None:
    """P(max of n normal steps' last value crosses): the first step's crossing of 0+ is a Bernoulli event."""
    runs, level = 4000, 0.5
    crossed = 0
    for run in range(runs):
        trigger = StateCrosses(generator(run), component=0, value=level, direction="up", hold=1)
        draws = random_stream(11, run, "walk", "steps").standard_normal(1)
        trigger.note(0, [0.0])
        trigger.note(1, draws.tolist())
        crossed += trigger.active(2)
    low, high = binom.interval(1.0 - FALSE_ALARM, runs, norm.sf(level))
    assert low <= crossed <= high
