"""What our number says of the paper's: whether it holds, and where a single run of ours would be."""

from __future__ import annotations

import math
from enum import Enum

from orchestrator.reproduction.claims import CALIBRATION_ERROR, Value
from orchestrator.reproduction.measuring import FEWEST, RANGED, Found


class Word(Enum):
    """The verdict on a claim, as it is told."""

    AGREES = "agrees"
    AS_ONE_RUN = "as one run of ours"
    HOLDS = "holds"
    DIFFERS = "differs"
    FAILS = "does not hold"
    OPEN = "open"
    NOTHING = "-"


def word_on(value: Value, found: Found) -> Word:
    """Return what our number says of the paper's.

    A claim with bounds holds when the whole interval is within them. A number agrees when our interval holds
    it, and is as one run of ours when it lies where most single trials do: papers tend to show one run. Of
    too few trials nothing else is said, unless the largest of them is beyond a bound already.
    """
    if math.isnan(found.number.value):
        return Word.NOTHING
    if value.at_most is not None or value.at_least is not None:
        word = _on_bounds(value, found)
        settled = value.statistic == "max" and word is Word.FAILS and value.at_most is not None
        return word if found.trials >= FEWEST or settled else Word.OPEN
    if not isinstance(value.paper, int | float):
        return Word.NOTHING
    if found.trials >= FEWEST and found.number.holds(value.paper):
        return Word.AGREES
    low, high = found.range
    if low <= value.paper <= high:
        return Word.AS_ONE_RUN
    has_interval = not math.isnan(found.number.low) or value.statistic == "max"
    return Word.DIFFERS if has_interval and found.trials >= _needed(value) else Word.OPEN


def why_open(value: Value, found: Found) -> str:
    """Return how many trials a claim needs that is open for want of trials, or nothing."""
    needed = _needed(value)
    return f"fewer than {needed} trials" if found.trials < needed else ""


def _needed(value: Value) -> int:
    """Return the fewest trials for a verdict: a number may also be as one run, which takes more to tell."""
    bounded = value.at_most is not None or value.at_least is not None
    has_no_range = value.statistic in ("share", CALIBRATION_ERROR)
    return FEWEST if bounded or has_no_range else RANGED


def _on_bounds(value: Value, found: Found) -> Word:
    low = -math.inf if value.at_least is None else value.at_least
    high = math.inf if value.at_most is None else value.at_most
    own = found.number
    begin, end = own.low, own.high
    if value.statistic == "max":
        begin = end = own.value
    if begin >= low and end <= high:
        return Word.HOLDS
    return Word.FAILS if begin > high or end < low else Word.OPEN
