"""When something acts, besides its window of steps: periodically, by chance, or when something happens.

A schedule is asked for a step, in any order over its askers. Triggers are told what they watch of every step
and act one step later at the earliest, so that what they decide is the same in one process or many.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, Protocol

import numpy as np
from annotated_types import Ge

from bus.kinds import load_class
from bus.plan import Plan, TimingPlan
from bus.quantities import Probability
from bus.random_streams import random_stream

Steps = Annotated[int, Ge(0)]
_BLOCK = 256


class Schedule(Protocol):
    """A schedule. A kind is constructed as ``Kind(generator, **parameters)``."""

    def active(self, step: int) -> bool:
        """Return whether a step is one of action."""
        ...


class Trigger(Schedule, Protocol):
    """A schedule that watches a node. Its steps come in order; each is noted before the next is asked for."""

    @staticmethod
    def watches(parameters: dict[str, Any], plant: str) -> str:
        """Return the name of the node to watch: the plant's true state, or an estimator's alarms."""
        ...

    def note(self, step: int, values: Sequence[float]) -> None:
        """Take what the node told of a step: the true state (n,), or the number of alarms (1,)."""
        ...


class Periodic:
    """Acts for some steps of every period.

    Parameters
    ----------
    every
        Length of the period (steps).
    steps_on
        Steps of action at the beginning of each period.
    offset
        Step in which the first period begins; nothing happens before.
    """

    def __init__(
        self,
        generator: np.random.Generator,
        *,
        every: Annotated[int, Ge(1)],
        steps_on: Annotated[int, Ge(1)] = 1,
        offset: Steps = 0,
    ) -> None:
        if steps_on > every:
            raise ValueError(f"steps_on {steps_on} is more than the period {every}")
        self._every, self._on, self._offset = every, steps_on, offset

    def active(self, step: int) -> bool:
        """Return whether a step is one of action."""
        return step >= self._offset and (step - self._offset) % self._every < self._on


class BernoulliSchedule:
    """Acts in each step with one probability, independently (the l_k of Sadeghzadeh-Nokhodberiz 2022).

    Parameters
    ----------
    probability
        The probability of action.
    """

    def __init__(self, generator: np.random.Generator, *, probability: Probability) -> None:
        self._generator = generator
        self._probability = probability
        self._active: list[bool] = []

    def active(self, step: int) -> bool:
        """Return whether a step is one of action."""
        while step >= len(self._active):
            self._active += (self._generator.random(_BLOCK) < self._probability).tolist()
        return self._active[step]


class MarkovSchedule:
    """Switches on and off as a chain of two states.

    Parameters
    ----------
    start
        P(off -> on): the probability that a step begins it.
    stop
        P(on -> off): the probability that a step ends it.
    initial
        The state before step 0; ``stationary`` draws it from the long run's law.
    """

    def __init__(
        self,
        generator: np.random.Generator,
        *,
        start: Probability,
        stop: Probability,
        initial: Literal["off", "on", "stationary"] = "off",
    ) -> None:
        self._generator = generator
        self._start, self._stop = start, stop
        share = start / (start + stop) if start + stop > 0.0 else 0.0
        first = float(generator.random())
        self._on = initial == "on" if initial != "stationary" else first < share
        self._active: list[bool] = []

    def active(self, step: int) -> bool:
        """Return whether a step is one of action."""
        while step >= len(self._active):
            for draw in self._generator.random(_BLOCK).tolist():
                self._on = draw >= self._stop if self._on else draw < self._start
                self._active.append(self._on)
        return self._active[step]


class _Held:
    """Action from the step after a cause on, for ``hold`` steps, or for good when ``hold`` is 0."""

    def __init__(self, delay: int, hold: int) -> None:
        self._delay, self._hold = delay, hold
        self._spans: list[tuple[int, float]] = []
        self._noted = -1

    def is_new(self, step: int) -> bool:
        """Return whether a step was not noted before; it is now."""
        new = step > self._noted
        self._noted = max(self._noted, step)
        return new

    def begin(self, cause: int) -> None:
        """Note that the cause came about in a step."""
        first = cause + self._delay
        self._spans.append((first, first + self._hold - 1 if self._hold else float("inf")))

    def active(self, step: int) -> bool:
        """Return whether a step is one of action."""
        return any(first <= step <= last for first, last in self._spans)


class StateCrosses:
    """Acts once a component of the true state crosses a value.

    Parameters
    ----------
    component
        Index of the component.
    value
        The value, in the component's unit.
    direction
        ``up`` from below to at least the value, ``down`` from above to at most the value, or ``any``.
    delay
        Steps from the crossing to the action, at least 1.
    hold
        Steps of action; 0 acts to the end of the run.
    once
        Whether later crossings are ignored.
    """

    closed_loop: ClassVar[bool] = True

    def __init__(
        self,
        generator: np.random.Generator,
        *,
        component: Steps,
        value: float,
        direction: Literal["up", "down", "any"] = "any",
        delay: Annotated[int, Ge(1)] = 1,
        hold: Steps = 0,
        once: bool = False,
    ) -> None:
        self._component, self._value, self._direction = component, value, direction
        self._once = once
        self._held = _Held(delay, hold)
        self._last: float | None = None
        self._crossed = False

    @staticmethod
    def watches(parameters: dict[str, Any], plant: str) -> str:
        """Return the plant's name: it watches the true state."""
        return plant

    def note(self, step: int, values: Sequence[float]) -> None:
        """Take the true state of a step."""
        if not self._held.is_new(step):
            return
        if self._component >= len(values):
            raise ValueError(f"component {self._component} is not in a state of {len(values)} components")
        before, now = self._last, values[self._component]
        self._last = now
        if before is None or (self._once and self._crossed):
            return
        rises = before < self._value <= now
        falls = before > self._value >= now
        if (rises and self._direction != "down") or (falls and self._direction != "up"):
            self._crossed = True
            self._held.begin(step)

    def active(self, step: int) -> bool:
        """Return whether a step is one of action."""
        return self._held.active(step)


class Alarm:
    """Acts after an estimator's detector raised an alarm, or as long as it raises none.

    Parameters
    ----------
    of
        The estimator to watch.
    delay
        Steps from the alarm to the action, at least 1.
    hold
        Steps of action after each alarm; 0 acts to the end of the run.
    invert
        Act while an alarm is *not* answered: an adversary that lies low after each alarm.
    """

    closed_loop: ClassVar[bool] = True

    def __init__(
        self,
        generator: np.random.Generator,
        *,
        of: str,
        delay: Annotated[int, Ge(1)] = 1,
        hold: Steps = 0,
        invert: bool = False,
    ) -> None:
        self._invert = invert
        self._held = _Held(delay, hold)

    @staticmethod
    def watches(parameters: dict[str, Any], plant: str) -> str:
        """Return the name of the estimator."""
        return str(parameters["of"])

    def note(self, step: int, values: Sequence[float]) -> None:
        """Take the number of alarms of a step."""
        if self._held.is_new(step) and values and values[0] > 0.0:
            self._held.begin(step)

    def active(self, step: int) -> bool:
        """Return whether a step is one of action."""
        return self._held.active(step) != self._invert


class Timing:
    """A window of steps, and a schedule inside it if there is one."""

    def __init__(self, plan: Plan, timing: TimingPlan) -> None:
        self.first, self.last = timing.first, timing.last
        self.watches = timing.watches
        self.schedule: Any = None
        if timing.when is not None:
            generator = random_stream(plan.seed, plan.trial, timing.stream, timing.purpose)
            self.schedule = load_class(timing.when.reference)(generator, **timing.when.parameters)

    def active(self, step: int) -> bool:
        """Return whether a step is one of action."""
        if not self.first <= step <= self.last:
            return False
        return self.schedule is None or bool(self.schedule.active(step))

    def note(self, step: int, values: Sequence[float]) -> None:
        """Tell a trigger what it watches."""
        self.schedule.note(step, values)
