"""What a page of many trials tells apart: estimators of one kind in one variant of one source."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.columns import Rows, in_usual_order, state_groups
from orchestrator.score.gather import Bools, Floats

ALL, ATTACKED = "all", "attacked"


@dataclass(frozen=True)
class Group:
    """The rows of some estimators of one variant, under a name of its own.

    What the name is made of: the ``title`` of the source, where there are several; the ``settings`` of the
    variant, by path, and the same in a few ``words``; and the ``part`` of its estimators. ``variant`` is the
    number of the source and of its variant, ``nodes`` are the estimators, and ``attacked`` those of them that
    an attack reached in any trial. ``judged`` holds the rows with the packets that detectors judged, of fewer
    trials where these are very many. ``document`` is the resolved topology.

    ``number`` is its place among all groups of the page, from 1. ``is_twin`` tells that it is what another
    group would have been without its attacks. ``rank`` is its place by its error, from 0, twins after all
    others: of many groups figures show the first of these before anybody asks for more.
    """

    name: str
    title: str
    settings: Mapping[str, str]
    words: Mapping[str, str]
    part: str
    variant: tuple[int, int]
    rows: Rows
    judged: Rows
    nodes: Sequence[str]
    attacked: Sequence[str]
    document: Mapping[str, Any]
    number: int = 0
    is_twin: bool = False
    rank: int = 0

    @property
    def variant_name(self) -> str:
        """The name of its variant: without the part, unless there is nothing else."""
        return ", ".join(filter(None, (self.title, *self.words.values()))) or self.part

    @property
    def is_apart(self) -> bool:
        """Whether none of its estimators exchanges anything with another one."""
        edges = (self.document.get("graph") or {}).get("edges") or []
        return not any({*edge[:2]}.intersection(self.nodes) for edge in edges)

    @property
    def from_step(self) -> int:
        """The first step that counts in averages."""
        return int(self._options.get("from_step", 0))

    @property
    def confidence(self) -> float:
        """The confidence of intervals and bounds."""
        return float(self._options.get("confidence", CONFIDENCE))

    @property
    def period_s(self) -> float:
        """The length of a step (s)."""
        return float(self.document["period_s"])

    @property
    def _options(self) -> Mapping[str, Any]:
        return self.document.get("score") or {}

    def of(self, which: str) -> Rows:
        """Return the rows of all estimators, of the attacked ones, or of the one that is named."""
        if which == ALL:
            return self.rows
        names = set(self.attacked) if which == ATTACKED else {which}
        keep = np.array([node in names for node in self.rows.text("node")], dtype=bool)
        places = np.flatnonzero(keep)
        return Rows(self.rows.table.take(places), self.rows.keys, self.rows.trial[keep], self.rows.failed)

    @property
    def passed(self) -> Bools:
        """Which trials (T,) held all that was expected."""
        own = np.zeros(self.rows.trials, dtype=bool)
        own[self.rows.trial[self.rows.scalar("passed") == 1.0]] = True
        return own

    @property
    def diverged(self) -> Bools:
        """In which trials (T,) any of these estimators diverged."""
        own = np.zeros(self.rows.trials, dtype=bool)
        own[self.rows.trial[np.isfinite(self.rows.scalar("divergence_step"))]] = True
        return own


def judged_by_expectations(groups: Sequence[Group]) -> list[Group]:
    """Return the groups that are held to what is expected: all but unattacked twins.

    What a file expects, it expects of the attack; and a twin that errs least says nothing of an estimator.
    """
    return [group for group in groups if not group.is_twin]


def state_names(groups: Sequence[Group]) -> list[str]:
    """Return the state groups that all tell errors of, in their usual order: ``state``, all of it, last."""
    told = [state_groups(group.rows.table) for group in groups]
    found = [name for name in told[0] if name != "state" and all(name in own for own in told)]
    return [*in_usual_order(found), "state"]


@dataclass(frozen=True)
class Outcomes:
    """What became of trials: how many there are, and how many of them were each of these."""

    trials: int
    passed: int
    diverged: int
    failed: int

    @staticmethod
    def of(groups: Sequence[Group]) -> Outcomes:
        """Return the outcomes of the trials of some groups; groups of one variant have the same trials."""
        variants: dict[tuple[int, int], list[Group]] = {}
        for group in groups:
            variants.setdefault(group.variant, []).append(group)
        own = list(variants.values())
        return Outcomes(
            trials=sum(parts[0].rows.trials for parts in own),
            passed=sum(int(np.any([part.passed for part in parts], axis=0).sum()) for parts in own),
            diverged=sum(int(np.any([part.diverged for part in parts], axis=0).sum()) for parts in own),
            failed=sum(int(parts[0].rows.failed.sum()) for parts in own),
        )


def trial_rmse(rows: Rows, group: str) -> Floats:
    """Return the RMSE (T,) of each trial over its estimators: infinite if one diverged, NaN if none came."""
    squares = rows.scalar(f"rmse.{group}") ** 2
    known = ~np.isnan(squares)
    total, count = (rows.by_trial(part) for part in (np.where(known, squares, 0.0), known.astype(np.float64)))
    with np.errstate(invalid="ignore"):
        mean: Floats = np.sqrt(total / count)
    return mean


def short_names(paths: Sequence[str]) -> dict[str, str]:
    """Return for each path as many of its last parts as tell it from the others."""
    found = {}
    for path in paths:
        parts = path.split(".")
        for length in range(1, len(parts) + 1):
            short = ".".join(parts[-length:])
            if sum(f".{other}".endswith(f".{short}") for other in paths) == 1:
                break
        found[path] = short
    return found


def described(settings: Mapping[str, str]) -> dict[str, str]:
    """Return each setting in a few words, by its path: as much of that as tells it apart, and the value."""
    short = short_names(list(settings))
    return {path: f"{short[path]} {value}" for path, value in settings.items()}
