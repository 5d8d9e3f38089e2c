"""What may be asserted of trials: it holds where it should, and fails with its numbers where not."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from orchestrator.score.repetition import differences
from orchestrator.score_of_log import score_of_log
from orchestrator.testing.trials import Trials
from tests.orchestrator.testing.conftest import Make, log_in, of


def test_a_score_from_memory_is_that_of_the_log(calm_trials: Trials) -> None:
    logged, own = score_of_log(calm_trials.log(3)), calm_trials.scores[3]
    assert differences(logged, own) == {}
    assert calm_trials.log(3) == calm_trials.log(3)


def test_a_bound_that_is_too_tight_names_the_seeds_above_it(calm_trials: Trials) -> None:
    calm_trials.assert_rmse("position", at_most=0.15)
    with pytest.raises(
        AssertionError, match=r"RMSE of position of e1 is 0\.0\S+, expected at most 0\.001"
    ) as told:
        calm_trials.assert_rmse("position", at_most=0.001, node="e1..e2")
    blamed = re.search(r"above it alone, 10 of 10: (.*)", str(told.value))
    assert blamed is not None
    worst, figure = re.findall(r"seed (\d) \(([0-9.]+)\)", blamed[1])[0]
    score = score_of_log(log_in(told))
    assert str(score.seed) == worst
    largest = max(node.groups["position"].rmse or 0.0 for node in score.nodes)
    assert largest == max(node.groups["position"].rmse for own in calm_trials.scores for node in own.nodes)
    assert largest == pytest.approx(float(figure), rel=1e-3)


def test_one_seed_above_the_bound_fails_only_where_each_must_keep_it(calm_trials: Trials) -> None:
    values = sorted(score.nodes[0].groups["position"].rmse or 0.0 for score in calm_trials.scores)
    calm_trials.assert_rmse("position", at_most=values[-2], node="e1")
    calm_trials.assert_rmse("position", at_most=values[-1], node="e1", each_seed=True)
    with pytest.raises(AssertionError, match="above it alone, 1 of 10"):
        calm_trials.assert_rmse("position", at_most=values[-2], node="e1", each_seed=True)


def test_a_consistent_filter_fails_at_no_more_than_the_stated_rate(make: Make) -> None:
    """36 campaigns of 3 seeds at a false-alarm rate of 10 %: 13 or more failures have probability 2.5e-5."""
    overrides = ("steps=10", "expect=null")
    trials = make("calm.yaml", range(108), *overrides)
    failed = 0
    for first in range(0, 108, 3):
        few = of(trials, trials.trials[first : first + 3], *overrides)
        try:
            few.assert_consistent(node="e1", false_alarm=0.1)
        except AssertionError:
            failed += 1
    assert failed < 13


@pytest.mark.parametrize(("factor", "low", "high"), [(4.0, 2.5, 9.0), (0.2, 0.01, 0.6)])
def test_covariances_that_lie_are_found_on_either_side(
    make: Make, factor: float, low: float, high: float
) -> None:
    method = f"estimators.e2={{method: './overconfident.py:Overconfident', factor: {factor}}}"
    trials = make("calm.yaml", range(5, 25), method)
    trials.assert_consistent(node="e1")
    with pytest.raises(
        AssertionError, match=r"ANEES of e2 over its degrees of freedom is \S+ at step"
    ) as told:
        trials.assert_consistent(false_alarm=1e-3)
    (ratio,) = re.findall(r"degrees of freedom is (\S+) at", str(told.value))
    assert low < float(ratio) < high
    assert "e1" not in str(told.value)
    assert "false-alarm rate of this assertion: 0.001" in str(told.value)


def test_a_filter_that_publishes_nothing_to_judge_by_is_not_called_consistent(
    make: Make, folder: Path
) -> None:
    (folder / "mute.py").write_text(
        "import numpy as np\nfrom nodes.contract import Belief\n"
        "from nodes.estimators.kalman import Kalman\n\n\n"
        "class Mute(Kalman):\n    def estimate(self, step):\n"
        "        return Belief(state=super().estimate(step).state, covariance=np.zeros((3, 3)))\n"
    )
    trials = make("calm.yaml", range(2), "estimators.e2.method=./mute.py:Mute")
    with pytest.raises(AssertionError, match="e2 publishes neither a usable covariance nor NIS"):
        trials.assert_consistent()


def test_one_covariance_that_is_not_positive_definite_fails_whatever_the_others_say(
    make: Make, folder: Path
) -> None:
    (folder / "negative.py").write_text(
        "from nodes.contract import Belief\n"
        "from nodes.estimators.kalman import Kalman\n\n\n"
        "class Negative(Kalman):\n"
        "    def __init__(self, setting, *, steps: int):\n"
        "        super().__init__(setting)\n"
        "        self.steps = steps\n\n"
        "    def estimate(self, step):\n"
        "        belief = super().estimate(step)\n"
        "        sign = -1.0 if step % 40 >= 40 - self.steps else 1.0\n"
        "        return Belief(state=belief.state, covariance=sign * belief.covariance)\n"
    )

    def negative(steps: int, *more: str) -> Trials:
        method = f"{{method: './negative.py:Negative', steps: {steps}}}"
        return make("calm.yaml", range(3, 6), f"estimators.e2={method}", *more)

    trials = negative(37)
    assert [score.nodes[1].nees_undefined for score in trials.scores] == [37] * 3
    with pytest.raises(AssertionError) as told:
        trials.assert_consistent()
    assert "e2 has no usable covariance in 111 of 120 estimates" in str(told.value)
    assert "not positive definite, first at step 3 of seed 3" in str(told.value)
    assert "without a usable covariance: seed 3 (37 estimates)" in str(told.value)
    assert "e1" not in str(told.value).split("\n", 1)[1].split("again, in")[0]
    with pytest.raises(AssertionError, match="no usable covariance in 3 of 120 estimates"):
        negative(1).assert_consistent()
    negative(0).assert_consistent()
    trials.assert_consistent(node="e1")


def test_a_program_that_never_publishes_a_covariance_is_judged_by_its_nis_alone(calm_trials: Trials) -> None:
    """On the wire a covariance may be empty. One that publishes some owes them all."""

    def without(covariances: slice) -> Trials:
        trials = []
        for trial in calm_trials.trials:
            own, held = trial.evidence, trial.evidence.gathered.estimates
            covariance, nees = held.covariance.copy(), own.nees.copy()
            covariance[1, covariances], nees[1, covariances] = np.nan, np.nan
            gathered = replace(own.gathered, estimates=replace(held, covariance=covariance))
            trials.append(replace(trial, evidence=replace(own, gathered=gathered, nees=nees)))
        return of(calm_trials, trials)

    without(slice(None)).assert_consistent()
    with pytest.raises(AssertionError, match="e2 has no usable covariance in 390 of 400 estimates"):
        without(slice(1, None)).assert_consistent()


def test_a_filter_that_diverges_is_neither_accurate_nor_consistent(make: Make) -> None:
    trials = make("calm.yaml", range(2), "score.divergence_bound=1e-6", "expect=null")
    with pytest.raises(AssertionError, match="RMSE of state of e1 is without bound"):
        trials.assert_rmse(at_most=1e9)
    with pytest.raises(AssertionError, match="e1 diverged at seed 0, 1"):
        trials.assert_consistent()


def test_expectations_and_metrics_hold_or_fail_at_every_seed(make: Make, calm_trials: Trials) -> None:
    calm_trials.assert_passes()
    calm_trials.assert_metric("packets.lost", equals=0)
    with pytest.raises(
        AssertionError, match=r"packets.sent at least 1000: 80 .*at the worst of 10 of 10 seeds"
    ):
        calm_trials.assert_metric("packets.sent", at_least=1000)
    strict = make("calm.yaml", range(3), "expect.rmse.position.at_most=0.001")
    with pytest.raises(
        AssertionError, match=r"rmse.position at most 0.001: 0.* worst of 3 of 3 seeds"
    ) as told:
        strict.assert_passes()
    assert not score_of_log(log_in(told)).passed


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda trials: trials.assert_rmse("positon", at_most=1.0), "did you mean 'rmse.position'"),
        (lambda trials: trials.assert_rmse(at_most=1.0, node="e7"), "there is no estimator 'e7'"),
        (lambda trials: trials.assert_detects_within(3, link="s7->e1"), "there is no link 's7->e1'"),
        (lambda trials: trials.assert_metric("packets.lost"), "give at_most, at_least or equals"),
        (lambda trials: trials.assert_consistent(false_alarm=2.0), "a probability between 0 and 1"),
        (lambda trials: trials.log(11), "seed 11 was not run"),
    ],
)
def test_an_assertion_that_cannot_be_meant_says_how_to_mend_it(
    calm_trials: Trials, call: Callable[[Trials], object], words: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(words)):
        call(calm_trials)


def test_trials_without_expectations_pass_nothing(make: Make) -> None:
    with pytest.raises(ValueError, match="states no expectation"):
        make("calm.yaml", range(1), "expect=null").assert_passes()
