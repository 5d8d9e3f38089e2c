"""Who errs least of the groups of a page, and whether that is shown or only happened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.comparison import Verdict, compare
from orchestrator.evidence.figures import rmse
from orchestrator.evidence.intervals import Interval
from orchestrator.evidence.ranks import holm
from orchestrator.report.campaign_tables import interval
from orchestrator.report.comparison import contender_of
from orchestrator.report.groups import Group, judged_by_expectations, state_names


@dataclass(frozen=True)
class Best:
    """The ``group`` with the smallest RMSE of a state group, and whether it is shown to beat all ``others``.

    Unattacked twins are no rivals: that they err least says nothing of an estimator.
    """

    group: Group
    state: str
    error: Interval
    others: Sequence[Group]
    is_shown: bool

    @property
    def headline(self) -> str:
        """The sentence on it at the head of a page."""
        where = "the state" if self.state == "state" else self.state
        how = "shown to be better than every other" if self.is_shown else "not shown to be the best"
        whose = f"{self.group.name}: {interval(self.error)}"
        return f"The smallest RMSE of {where} is that of {whose}; it is {how}."

    @property
    def evidence(self) -> str:
        """How that was found out, beside the comparison of every two."""
        others = f"each of the {len(self.others)} others" if len(self.others) > 1 else "the other one"
        beaten = "shown to be better every time" if self.is_shown else "not shown to be better every time"
        return (
            f"{self.group.name} errs least in rmse.{self.state}. Tested against {others}, with p values "
            f"adjusted among these tests alone, it is {beaten}."
        )


def find_best(groups: Sequence[Group]) -> Best | None:
    """Return who errs least of the groups of a page; None where nobody has a rival."""
    state = state_names(groups)[0]
    rivals = judged_by_expectations(groups)
    errors = [rmse(own.rows, state, own.confidence) for own in rivals]
    known = [i for i, error in enumerate(errors) if np.isfinite(error.value)]
    if len(known) < 2:
        return None
    least = min(known, key=lambda i: errors[i].value)
    others = [own for i, own in enumerate(rivals) if i != least]
    return Best(rivals[least], state, errors[least], others, _beats(rivals[least], others, f"rmse.{state}"))


def _beats(best: Group, others: Sequence[Group], metric: str) -> bool:
    """Return whether a group is shown to be better than each of the others in a metric.

    The claim needs every test to come out for it (Berger 1982, Technometrics 24:295); the p values are
    adjusted among these tests all the same (Holm).
    """
    single = [
        compare([contender_of(best), contender_of(other)], [metric], best.confidence).compared[0]
        for other in others
    ]
    wins = all(own.verdict is Verdict.FIRST for own in single)
    return wins and max(holm([own.difference.p_value for own in single])) <= 1.0 - best.confidence
