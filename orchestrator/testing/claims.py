"""What tests claim of trials, judged: the numbers, and which seeds are to blame. Nothing is run here."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.score.catalogue import find_metric, metric_names
from orchestrator.score.expectation import Expectation
from orchestrator.score.judging import judge_expectations, show
from orchestrator.score.link_results import AttackWindow
from orchestrator.score.measure import node_value
from orchestrator.score.results import Outcome, Score
from orchestrator.score.scoring import Evidence
from orchestrator.topology.names import select
from orchestrator.topology.problems import did_you_mean
from orchestrator.topology.resolved import Topology
from orchestrator.topology.targets import links_of_pattern

Names = str | Sequence[str] | None
"""Which nodes or links: a name, a range, a pattern, several of these, or None for all."""


@dataclass(frozen=True)
class Trial:
    """One run: its seed, its score, and the arrays that the score was computed from."""

    seed: int
    score: Score
    evidence: Evidence


@dataclass(frozen=True)
class Claim:
    """What became of a claim.

    Parameters
    ----------
    lines
        What does not hold, with its numbers; none when all holds.
    blame
        What the blamed seeds did.
    blamed
        Seeds to look at, the worst first, each with its number.
    """

    lines: tuple[str, ...]
    blame: str = ""
    blamed: tuple[tuple[int, str], ...] = ()

    @property
    def holds(self) -> bool:
        """Whether all of it holds."""
        return not self.lines


def _chosen(what: str, wanted: Names, names: Sequence[str]) -> list[str]:
    """Return the names that are meant; raises ValueError for one that is not there."""
    if wanted is None:
        return list(names)
    chosen: dict[str, None] = {}
    for pattern in [wanted] if isinstance(wanted, str) else wanted:
        found = select(pattern, names) if what == "estimator" else links_of_pattern(pattern, names)
        if not found:
            raise ValueError(f"there is no {what} '{pattern}'; {did_you_mean(pattern, names)}")
        chosen.update(dict.fromkeys(found))
    return list(chosen)


def estimators(topology: Topology, wanted: Names) -> list[str]:
    """Return the estimators that are meant; raises ValueError for one that is not there."""
    return _chosen("estimator", wanted, [own.name for own in topology.plan.estimators])


def _named_links(topology: Topology, wanted: Names) -> list[str]:
    return _chosen("link", wanted, [link.name for link in topology.plan.links])


def _check_metric(topology: Topology, name: str) -> None:
    if find_metric(name, topology.state_groups) is None:
        known = metric_names(topology.state_groups)
        raise ValueError(f"there is no metric '{name}'; {did_you_mean(name, known)}")


def _outcomes(trials: Sequence[Trial], found: Sequence[Sequence[Outcome]]) -> Claim:
    """Return the claim that all outcomes, of each trial in a list of its own, are passed."""
    broken: dict[int, list[tuple[int, Outcome]]] = defaultdict(list)
    for trial, outcomes in zip(trials, found, strict=True):
        for place, outcome in enumerate(outcomes):
            if not outcome.passed:
                broken[place].append((trial.seed, outcome))
    lines, blamed = [], dict[int, str]()
    for _, cases in sorted(broken.items()):
        cases.sort(key=lambda case: -_distance(case[1]))
        lines.append(f"{cases[0][1].message}, at the worst of {len(cases)} of {len(trials)} seeds that fail")
        for seed, outcome in cases:
            blamed.setdefault(seed, outcome.message)
    return Claim(tuple(lines), "fails", tuple(blamed.items()))


def _distance(outcome: Outcome) -> float:
    return math.inf if outcome.measured is None else abs(outcome.measured - outcome.bound)


def passes(trials: Sequence[Trial]) -> Claim:
    """Judge that every expectation of the file holds at every seed."""
    if not trials[0].score.expectations:
        raise ValueError(f"{trials[0].score.name} states no expectation; give it some under 'expect'")
    return _outcomes(trials, [trial.score.expectations for trial in trials])


def metric(
    topology: Topology,
    trials: Sequence[Trial],
    name: str,
    bounds: Mapping[str, float | None],
    node: Names,
    link: Names,
) -> Claim:
    """Judge bounds on a metric of the catalogue at every seed."""
    _check_metric(topology, name)
    if all(bound is None for bound in bounds.values()):
        raise ValueError(f"nothing is expected of {name}; give at_most, at_least or equals")
    nodes = () if node is None else tuple(estimators(topology, node))
    links = () if link is None else tuple(_named_links(topology, link))
    expected = Expectation(
        name,
        nodes,
        links,
        at_most=bounds.get("at_most"),
        at_least=bounds.get("at_least"),
        equals=bounds.get("equals"),
    )
    groups = topology.state_groups
    return _outcomes(trials, [judge_expectations(trial.score, [expected], groups) for trial in trials])


def rmse(
    topology: Topology, trials: Sequence[Trial], group: str, at_most: float, node: Names, *, each_seed: bool
) -> Claim:
    """Judge that the RMSE of a group is at most a bound, over all seeds or at each of them."""
    name = f"rmse.{group}"
    _check_metric(topology, name)
    lines, blamed = [], dict[int, float]()
    for estimator in estimators(topology, node):
        values = np.array([_node_value(trial.score, estimator, name) for trial in trials])
        whole = math.sqrt(float(np.mean(np.square(values))))
        above = ~(values <= at_most)
        if not whole <= at_most:
            lines.append(f"RMSE of {group} of {estimator} is {show(whole)}, expected at most {at_most:g}")
        elif each_seed and above.any():
            lines.append(
                f"RMSE of {group} of {estimator} is {show(values.max())} at the worst seed, "
                f"expected at most {at_most:g} at each"
            )
        else:
            continue
        for trial, value in zip(trials, values.tolist(), strict=True):
            blamed[trial.seed] = max(value, blamed.get(trial.seed, 0.0))
    ranked = sorted(blamed.items(), key=lambda item: -item[1])
    over = [(seed, show(value)) for seed, value in ranked if not value <= at_most]
    return Claim(tuple(lines), f"above it alone, {len(over)} of {len(trials)}", tuple(over))


def _node_value(score: Score, estimator: str, metric: str) -> float:
    node = next(node for node in score.nodes if node.name == estimator)
    value = node_value(score, node, metric)
    if math.isnan(value):
        raise ValueError(f"{metric} of {estimator} is undefined: no step of it was scored")
    return value


def detects_within(
    topology: Topology, trials: Sequence[Trial], steps: int, share: float, link: Names
) -> Claim:
    """Judge that at least a share of the attack windows on judged links is found within some steps."""
    links = set(_named_links(topology, link))
    windows = [
        (trial, window)
        for trial in trials
        for window in trial.score.windows
        if window.judged and window.link in links
    ]
    told = [pair for pair in windows if _was_watched(pair[1], pair[0].score, steps)]
    cut = len(windows) - len(told)
    if not told:
        cure = (
            f"; {cut} were cut off by the run's end: give a larger 'steps:', or attack earlier" if cut else ""
        )
        return Claim((f"no attack met a detector for {_steps(steps)}{cure}",))
    late = [pair for pair in told if pair[1].delay is None or pair[1].delay > steps]
    found = len(told) - len(late)
    if found >= share * len(told):
        return Claim(())
    left_out = f"; {cut} more were cut off by the run's end before that, and are left out" if cut else ""
    line = (
        f"{found} of {len(told)} attacks ({found / len(told):.3g}) were found within {_steps(steps)}, "
        f"expected a share of {share:g}{left_out}"
    )
    late.sort(key=lambda pair: -(math.inf if pair[1].delay is None else pair[1].delay))
    blamed: dict[int, str] = {}
    for trial, window in late:
        when = "never" if window.delay is None else f"after {_steps(window.delay)}"
        blamed.setdefault(trial.seed, f"{window.link} from step {window.first}: {when}")
    return Claim((line,), "found too late", tuple(blamed.items()))


def _steps(number: int) -> str:
    return "1 step" if number == 1 else f"{number} steps"


def _was_watched(window: AttackWindow, score: Score, steps: int) -> bool:
    """Return whether a window was watched for some steps, or for as long as an alarm could have found it.

    Whether it was found must not matter here: to keep what was found early in a window that the run's end
    cut off, and not what was missed in one, would count successes alone.
    """
    watched = score.steps - 1 - window.first
    return watched >= steps or window.last + score.options.detection_grace < score.steps - 1
