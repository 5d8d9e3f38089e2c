"""What may be asserted of trials: it holds where it should, and fails with its numbers where not."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from orchestrator.log.reader import read_log
from orchestrator.score.repetition import differences
from orchestrator.score.results import Score
from orchestrator.score_of_log import score_of_log
from orchestrator.testing.again import Source
from orchestrator.testing.claims import Trial
from orchestrator.testing.trials import TrialError, Trials, run_trials
from orchestrator.topology.load import load_topology
from tests.orchestrator.testing.conftest import ATTACKED, CALM, OVERCONFIDENT, RAISING

Make = Callable[..., Trials]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trials")
    for name, text in {
        "calm.yaml": CALM,
        "attacked.yaml": ATTACKED,
        "overconfident.py": OVERCONFIDENT,
    }.items():
        (folder / name).write_text(text)
    return folder


@pytest.fixture(scope="module")
def make(folder: Path) -> Make:
    def make(name: str, seeds: range, *overrides: str, backend: str = "inprocess") -> Trials:
        loaded = load_topology(folder / name, overrides, directory=folder)
        return run_trials(loaded, seeds, folder / "logs", backend, overrides, folder)

    return make


@pytest.fixture(scope="module")
def calm_trials(make: Make) -> Trials:
    return make("calm.yaml", range(10))


def of(trials: Trials, chosen: Sequence[Trial], *overrides: str) -> Trials:
    """Return some of the trials, or others in their place, as trials of the same topology."""
    file, folder = trials.topology.path, trials.topology.path.parent
    source = Source(file, overrides, folder, "inprocess", 0, folder / "logs", "logs")
    return Trials(trials.topology, chosen, source)


LEAKY = """
import os

from nodes.contract import Belief
from nodes.estimators.kalman import Kalman


class Leaky(Kalman):
    seen = []

    def estimate(self, step):
        self.seen.append(step)
        x, P = super().estimate(step).state, super().estimate(step).covariance
        if len(self.seen) > {much}:
            {effect}
        return Belief(state=x, covariance=P)
"""
"""An estimator whose every object appends to one list, and that goes wrong when it has grown."""


def log_in(failure: pytest.ExceptionInfo[AssertionError]) -> Path:
    """Return the log that a failed assertion points to."""
    (path,) = re.findall(r"log of seed \d+: (\S+)", str(failure.value))
    return Path(path)


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


def test_attacks_are_found_in_time_or_told_where_they_were_not(
    make: Make, folder: Path, calm_trials: Trials
) -> None:
    trials = make("attacked.yaml", range(6))
    trials.assert_detects_within(0, share=0.9)
    trials.assert_detects_within(5, link="s1->e1")
    blind = make("attacked.yaml", range(6), "estimators.e1.threshold=1e9")
    with pytest.raises(AssertionError) as told:
        blind.assert_detects_within(5, share=0.5)
    assert "0 of 6 attacks (0) were found within 5 steps, expected a share of 0.5" in str(told.value)
    assert "found too late: seed 0 (s1->e1 from step 20: never)" in str(told.value)
    assert f"again, in {folder}: gauntlet run attacked.yaml" in str(told.value)
    assert "--seed 0 --set estimators.e1.threshold=1e9 --backend inprocess" in str(told.value)
    assert "does not repeat" not in str(told.value)
    with pytest.raises(AssertionError, match="no attack met a detector"):
        calm_trials.assert_detects_within(5)


@pytest.mark.parametrize(
    ("steps", "share", "words"),
    [
        (-1, 0.5, "steps=-1 is negative; give steps from 0"),
        (1.5, 0.5, "steps=1.5 is a float, which is no whole number; give steps from 0"),
        (True, 0.5, "steps=True is a bool, which is no whole number"),
        (1, 1.7, "share=1.7: give a share above 0, up to 1"),
        (1, 0.0, "share=0: give a share above 0, up to 1"),
    ],
)
def test_a_share_or_delay_that_no_detector_could_have_is_refused(
    calm_trials: Trials, steps: int, share: float, words: str
) -> None:
    with pytest.raises((TypeError, ValueError), match=words):
        calm_trials.assert_detects_within(steps, share=share)


MOODY = """
from nodes.contract import Belief, Detection
from nodes.estimators.kalman import Kalman


class Moody(Kalman):
    def __init__(self, setting, *, mute: bool = False):
        super().__init__(setting, threshold=20.0, on_alarm="reject")
        self.works, self.mute = setting.rng.random() < 0.5, mute

    def estimate(self, step):
        own = super().estimate(step)
        told = own.detections
        if not self.works:
            told = [] if self.mute else [Detection(it.source, it.sequence, 0.0, False) for it in told]
        return Belief(state=own.state, covariance=own.covariance, detections=told)
"""
"""An estimator whose detector works in half of the trials, and in others gives no alarm, or no verdict."""


def moody(make: Make, folder: Path, seeds: range, *overrides: str, mute: bool) -> tuple[Trials, int]:
    """Return trials of a moody estimator, and how many of them gave an alarm."""
    (folder / "moody.py").write_text(MOODY)
    method = "estimators.e1.method=./moody.py:Moody", f"estimators.e1.mute={str(mute).lower()}"
    trials = make("attacked.yaml", seeds, *method, *overrides)
    return trials, sum(own.windows[0].delay is not None for own in trials.scores)


def test_a_trial_without_a_verdict_counts_as_one_without_an_alarm(make: Make, folder: Path) -> None:
    failures = []
    for mute in (False, True):
        trials, found = moody(make, folder, range(12), mute=mute)
        assert 0 < found < 12
        assert sum(score.windows[0].judged for score in trials.scores) == (found if mute else 12)
        trials.assert_detects_within(5, share=found / 12)
        with pytest.raises(AssertionError, match=f"{found} of 12 attacks .* expected a share of 1") as told:
            trials.assert_detects_within(5, share=1.0)
        failures.append(str(told.value))
    assert "(s1->e1 from step 20: never)" in failures[0]
    assert "(s1->e1 from step 20: never, without a verdict)" in failures[1]


def test_links_that_no_trial_judged_count_only_when_they_are_named(make: Make) -> None:
    attacks = "attacks=[{bias: {value: 5}, on: 's*->e*', steps: [20, 25]}]"
    deaf, seeds = ("estimators.e2.threshold=null", "estimators.e2.on_alarm=flag", attacks), range(4)
    trials = make("attacked.yaml", seeds, *deaf)
    trials.assert_detects_within(5, share=1.0)
    with pytest.raises(AssertionError, match="4 of 8 attacks") as told:
        trials.assert_detects_within(5, share=1.0, link="s*->e*")
    assert "s2->e2 from step 20: never, without a verdict" in str(told.value)
    left_out = r"0 of 4 attacks .*; 4 more on links that no trial judged are left out"
    with pytest.raises(AssertionError, match=left_out):
        make("attacked.yaml", seeds, *deaf, "estimators.e1.threshold=1e9").assert_detects_within(5)
    nobody = ("estimators.e1.threshold=null", "estimators.e1.on_alarm=flag")
    none = r"no attack met a detector .*; 8 were on links that no detector judged"
    with pytest.raises(AssertionError, match=none):
        make("attacked.yaml", seeds, *deaf, *nobody).assert_detects_within(5)


def test_a_share_is_kept_when_it_is_met_exactly(make: Make, folder: Path) -> None:
    """14 of 25 are a share of 0.56, though 25 times 0.56 is more than 14 in binary numbers."""
    trials, _ = moody(make, folder, range(60), "steps=30", mute=False)
    found = [own for own in trials.trials if own.score.windows[0].delay is not None]
    missed = [own for own in trials.trials if own.score.windows[0].delay is None]
    of(trials, [*found[:14], *missed[:11]]).assert_detects_within(5, share=0.56)
    with pytest.raises(AssertionError, match="13 of 25 attacks"):
        of(trials, [*found[:13], *missed[:12]]).assert_detects_within(5, share=0.56)


def test_an_attack_that_the_end_cut_off_tells_nothing_either_way(make: Make) -> None:
    trials = make("attacked.yaml", range(3), "attacks[0].steps=[37, 39]", "estimators.e1.threshold=1e9")
    with pytest.raises(AssertionError, match="no attack met a detector for 3 steps; 3 were cut off"):
        trials.assert_detects_within(3)
    with pytest.raises(AssertionError, match="0 of 3 attacks"):
        trials.assert_detects_within(2)


def test_attacks_that_the_end_cut_off_do_not_count_as_found_where_the_missed_ones_do_not_count(
    make: Make,
) -> None:
    """A weak attack in the last 4 steps is found in few of 20 seeds: within 10 steps nothing is known."""
    trials = make("attacked.yaml", range(20), "attacks[0].steps=[36, 39]", "attacks[0].bias.value=1")
    found = [window.delay is not None for score in trials.scores for window in score.windows]
    assert 0 < sum(found) < len(found) == 20
    with pytest.raises(AssertionError, match="no attack met a detector for 10 steps; 20 were cut off"):
        trials.assert_detects_within(10)
    with pytest.raises(AssertionError, match=rf"{sum(found)} of 20 attacks .* within 3 steps"):
        trials.assert_detects_within(3)


def test_a_failure_tells_how_many_attacks_the_end_cut_off(make: Make) -> None:
    """The earlier attack is missed in every seed; the later one, found at once, is watched for 4 steps."""
    early, late = (
        "{bias: {value: 0.01}, on: s1->e1, steps: [10, 12]}",
        "{bias: {value: 5}, on: s2->e2, steps: [36, 39]}",
    )
    trials = make("attacked.yaml", range(4), f"attacks=[{early}, {late}]")
    later = [window for score in trials.scores for window in score.windows if window.link == "s2->e2"]
    assert [window.delay for window in later] == [0] * 4
    with pytest.raises(AssertionError) as told:
        trials.assert_detects_within(10, share=0.5)
    assert "0 of 4 attacks (0) were found within 10 steps" in str(told.value)
    assert "expected a share of 0.5; 4 more were cut off by the run's end before that" in str(told.value)
    trials.assert_detects_within(3, share=0.5)


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


def test_both_backends_give_the_same_scores_and_logs(make: Make) -> None:
    one, many = (make("attacked.yaml", range(1), backend=backend) for backend in ("inprocess", "processes"))
    assert one.scores == many.scores
    assert one.log(0).read_bytes() == many.log(0).read_bytes()
    assert read_log(many.log(0)).complete


def run_as_told(failure: str) -> Score:
    """Carry out the command that a failure names, as a shell would, and return the score that it comes to."""
    (folder, rest) = re.findall(r"again, in (.*): gauntlet (.*)", failure)[0]
    command = [sys.executable, "-m", "orchestrator.command_line.app", *shlex.split(rest), "--out", "again"]
    (directory,) = shlex.split(folder)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run(
        command, cwd=directory, env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode in (0, 1), done.stderr
    return Score.from_json((Path(directory) / "again" / "score.json").read_bytes())


def test_the_command_of_a_failure_runs_its_trial_whatever_files_are_called(tmp_path: Path) -> None:
    home = tmp_path / "it's my own"
    (home / "a filter").mkdir(parents=True)
    (home / "calm one.yaml").write_text(CALM)
    (home / "a filter" / "over confident.py").write_text(OVERCONFIDENT)
    overrides = ["estimators.e2.method='./a filter/over confident.py:Overconfident'"]
    loaded = load_topology(home / "calm one.yaml", overrides, directory=home)
    trials = run_trials(loaded, [3, 5], tmp_path / "logs", overrides=overrides, directory=home)
    with pytest.raises(AssertionError) as told:
        trials.assert_rmse(at_most=0.0, node="e2")
    score = run_as_told(str(told.value))
    assert differences(score, trials.scores[trials.seeds.index(score.seed)]) == {}


def leaky(folder: Path, name: str, effect: str, much: int = 100) -> list[str]:
    """Write an estimator that keeps state between trials, and return what makes a topology use it."""
    (folder / f"{name}.py").write_text(LEAKY.format(effect=effect, much=much))
    return [f"estimators.e2.method=./{name}.py:Leaky", "expect=null"]


def test_a_trial_that_a_log_does_not_repeat_is_told_with_both_figures(make: Make, folder: Path) -> None:
    """The list outgrows 100 in the third trial of 40 steps, and is full from the fourth on."""
    trials = make("calm.yaml", [1, 2, 3, 4], *leaky(folder, "leaky", "x = x + 0.3"))
    with pytest.raises(AssertionError, match="log of seed 4") as told:
        trials.assert_rmse("position", at_most=0.15, node="e2")
    logged = score_of_log(log_in(told))
    assert differences(logged, run_as_told(str(told.value))) == {}, "the log is that of the command"
    here, there = (score.nodes[1].groups["position"].rmse for score in (logged, trials.scores[3]))
    figures = f"nodes[e2].groups.position.rmse is {here:.4g} in this log, and was {there:.4g} in the trial"
    assert f"the run does not repeat: {figures}" in str(told.value)
    assert "keeps state between trials" in str(told.value)
    with pytest.warns(UserWarning, match="log of seed 3: the run does not repeat"):
        trials.log(3)
    trials.log(1)


def test_a_run_that_fails_in_one_trial_only_is_not_called_the_log_of_that_trial(
    make: Make, folder: Path
) -> None:
    overrides = leaky(folder, "failing", "raise ArithmeticError('too long')")
    with pytest.raises(TrialError, match="seed 3: e2 failed in step 20: ArithmeticError") as told:
        make("calm.yaml", [1, 2, 3, 4], *overrides)
    assert "the run does not repeat: this time it came to its end" in str(told.value)
    (log,) = re.findall(r"^log: (\S+)$", str(told.value), re.MULTILINE)
    assert read_log(Path(log)).complete


def test_trials_in_processes_keep_their_own_logs(make: Make, folder: Path) -> None:
    """Such an estimator draws anew in each run: only the log of the trial itself shows what failed."""
    effect = "x = x + int.from_bytes(os.urandom(2), 'big')"
    trials = make("calm.yaml", [3], *leaky(folder, "drawing", effect, much=0), backend="processes")
    with pytest.raises(AssertionError, match="--backend processes") as told:
        trials.assert_rmse("position", at_most=0.15, node="e2")
    assert differences(score_of_log(log_in(told)), trials.scores[0]) == {}


def test_a_log_that_cannot_be_written_hides_no_assertion_and_no_failing_node(
    calm_trials: Trials, folder: Path
) -> None:
    (folder / "file").touch()
    (folder / "raising.py").write_text(RAISING)
    asked = {"logs": folder / "file" / "logs", "directory": folder, "logs_option": "--kept"}
    trials = run_trials(load_topology(folder / "calm.yaml"), [3, 5], **asked)
    with pytest.raises(AssertionError) as told:
        trials.assert_rmse("position", at_most=0.001)
    assert "RMSE of position of e1 is 0.0" in str(told.value)
    assert "above it alone, 2 of 2: seed" in str(told.value)
    assert re.search(
        r"there is no log of seed \d: \S+file/logs: Not a directory; choose another --kept$", str(told.value)
    )
    overrides = ["estimators.e2.method=./raising.py:Raising"]
    raising = load_topology(folder / "calm.yaml", overrides, directory=folder)
    with pytest.raises(TrialError, match="seed 4: e2 failed in step 7: ArithmeticError") as failed:
        run_trials(raising, [4], overrides=overrides, **asked)
    assert re.search(
        r"there is no log: \S+file/logs: Not a directory; choose another --kept$", str(failed.value)
    )
