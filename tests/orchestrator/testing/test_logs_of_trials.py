"""The log of a failing trial is that of the trial, or the failure says that it is not."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from orchestrator.log.reader import read_log
from orchestrator.score.repetition import differences
from orchestrator.score.results import Score
from orchestrator.score_of_log import score_of_log
from orchestrator.testing.trials import TrialError, Trials, run_trials
from orchestrator.topology.load import load_topology
from tests.orchestrator.testing.conftest import CALM, OVERCONFIDENT, RAISING, Make, log_in

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
