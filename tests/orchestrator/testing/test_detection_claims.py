"""Which attacks count as found in time, and which tell nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from orchestrator.testing.trials import Trials
from tests.orchestrator.testing.conftest import Make, of


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
