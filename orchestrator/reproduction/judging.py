"""What our number says of the paper's: whether it holds, and where a single run of ours would be."""

from __future__ import annotations

import math
from enum import Enum

from orchestrator.reproduction.claims import Value
from orchestrator.reproduction.measuring import Found


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
    too few trials for an interval nothing else is said.
    """
    if math.isnan(found.number.value):
        return Word.NOTHING
    if value.at_most is not None or value.at_least is not None:
        return _on_bounds(value, found)
    if isinstance(value.paper, int | float):
        if found.number.holds(value.paper):
            return Word.AGREES
        low, high = found.range
        if low <= value.paper <= high:
            return Word.AS_ONE_RUN
        return Word.OPEN if math.isnan(found.number.low) and value.statistic != "max" else Word.DIFFERS
    return Word.NOTHING


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
