"""What estimators knew of signal attacks, on records whose figures are worked out by hand."""

from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console

from orchestrator.score.expectation import Expectation
from orchestrator.score.results import ScoreOptions, SignalWindow
from orchestrator.score.scoring import score
from orchestrator.score.verdict import print_verdict

SIGNAL = {2: (3.0, 4.0), 3: (3.0, 4.0), 4: (3.0, 0.0)}
"""A signal in the steps 2 to 4 of 8."""
R = (0.1, 0.7, 0.2, 0.9, 0.6, 0.8, 0.4, 0.3)


def play(recorder, *, steps=8, signal=SIGNAL, r=R, lag=0, value=None, node="e1", **options):
    """Record an estimator whose statement in step k is about step k - lag; of step j it says ``r[j]``."""
    for step in range(steps):
        if node == "e1":
            recorder.truth(step, [0.0], signal.get(step, (0.0, 0.0)))
        about = step - lag
        says = {} if r is None or about < 0 else {"attack_probability": r[about]}
        if lag:
            says["attack_step"] = float(about)
        if value is not None and about >= 0:
            says |= {f"a{i}": number for i, number in enumerate(value(about))}
        recorder.estimate(node, step, [0.0], diagnostics=says, **options)


def scored(make_plan, recorder, *expectations, steps=8, nodes=("e1",), **options):
    return score(
        make_plan(steps, {name: ["s1"] for name in nodes}),
        recorder.records,
        state_groups={},
        options=ScoreOptions(**options),
        expectations=expectations,
    )


def test_probabilities_alarms_and_delays_are_those_worked_out_by_hand(make_plan, recorder):
    play(recorder)
    found = scored(make_plan, recorder).nodes[0].attack
    assert found.probability_on == pytest.approx((0.2 + 0.9 + 0.6) / 3)
    assert found.probability_off == pytest.approx((0.1 + 0.7 + 0.8 + 0.4 + 0.3) / 5)
    assert (found.false_alarms, found.misses) == (2, 1)  # steps 1 and 5; step 2
    assert found.windows == [
        SignalWindow(first=2, last=4, statements=3, statements_after=3, detection_delay=1, release_delay=1)
    ]
    assert found.rmse is None


def test_averages_begin_at_the_first_scored_step_and_alarms_count_in_full(make_plan, recorder):
    play(recorder)
    found = scored(make_plan, recorder, from_step=3).nodes[0].attack
    assert found.probability_on == pytest.approx((0.9 + 0.6) / 2)
    assert found.probability_off == pytest.approx((0.8 + 0.4 + 0.3) / 3)
    assert (found.false_alarms, found.misses) == (2, 1)


def test_a_statement_about_the_step_before_is_judged_by_that_step_and_is_a_step_late(make_plan, recorder):
    play(recorder, r=(0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0), lag=1)
    found = scored(make_plan, recorder).nodes[0].attack
    assert (found.probability_on, found.probability_off) == (1.0, 0.0)
    assert (found.false_alarms, found.misses) == (0, 0)
    (window,) = found.windows
    assert (window.detection_delay, window.release_delay) == (1, 1)


def test_the_error_of_the_signal_is_the_norm_over_its_components_while_there_is_one(make_plan, recorder):
    off = {2: (3.0, 4.0), 3: (0.0, 0.0), 4: (1.0, 0.0)}

    def value(step):
        return np.array(SIGNAL.get(step, (0.0, 0.0))) + np.array(off.get(step, (99.0, 99.0)))

    play(recorder, value=value)
    assert scored(make_plan, recorder).nodes[0].attack.rmse == pytest.approx(((25.0 + 0.0 + 1.0) / 3) ** 0.5)
    later = scored(make_plan, recorder, from_step=3).nodes[0].attack
    assert later.rmse == pytest.approx((1.0 / 2) ** 0.5)


def test_an_estimate_without_probability_has_an_error_and_nothing_else(make_plan, recorder):
    play(recorder, r=None, value=lambda step: (3.0, 4.0))
    found = scored(make_plan, recorder).nodes[0].attack
    assert found.rmse == pytest.approx((16.0 / 3) ** 0.5)
    assert (found.probability_on, found.false_alarms, found.misses, found.windows) == (None, None, None, [])


@pytest.mark.parametrize("value", [(1.0,), (1.0, 2.0, 3.0)])
def test_an_estimate_of_another_size_than_the_signal_has_no_error(make_plan, recorder, value):
    play(recorder, value=lambda step: value)
    found = scored(make_plan, recorder).nodes[0].attack
    assert found.rmse is None
    assert found.misses == 1


def test_an_estimator_that_says_nothing_of_attacks_has_no_figures(make_plan, recorder):
    play(recorder, r=None)
    result = scored(make_plan, recorder, Expectation("attack.misses", nodes=("e1",), equals=0))
    assert result.nodes[0].attack is None
    assert result.expectations[0].message == (
        "attack.misses exactly 0: undefined for e1, it published no attack probability"
    )


def test_without_any_signal_every_alarm_is_false(make_plan, recorder):
    for step, r in enumerate(R):
        recorder.truth(step, [0.0])
        recorder.estimate("e1", step, [0.0], diagnostics={"attack_probability": r, "a0": 1.0})
    found = scored(make_plan, recorder).nodes[0].attack
    assert (found.false_alarms, found.misses) == (4, 0)
    assert found.probability_off == pytest.approx(sum(R) / 8)
    assert (found.probability_on, found.rmse, found.windows) == (None, None, [])


def test_of_several_attacks_the_longest_delay_counts_and_one_never_noticed_is_endless(make_plan, recorder):
    signal = dict.fromkeys((1, 2, 5, 6, 10), (1.0, 0.0))
    r = (0, 1, 1, 0, 0, 0, 1, 1, 1, 0, 0, 0)
    play(recorder, steps=12, signal=signal, r=r)
    found = scored(make_plan, recorder, steps=12).nodes[0].attack
    delays = [(window.first, window.detection_delay, window.release_delay) for window in found.windows]
    assert delays == [(1, 0, 0), (5, 1, 2), (10, None, 0)]
    expectations = [
        Expectation("attack.detection_delay", at_most=100),
        Expectation("attack.release_delay", equals=2),
        Expectation("attack.false_alarms", equals=2),
    ]
    result = scored(make_plan, recorder, *expectations, steps=12)
    assert [outcome.passed for outcome in result.expectations] == [False, True, True]
    assert "without bound" in result.expectations[0].message


def test_an_attack_that_lasts_to_the_end_has_no_release_delay(make_plan, recorder):
    play(recorder, signal=dict.fromkeys((6, 7), (1.0, 1.0)), r=(0, 0, 0, 0, 0, 0, 0, 1))
    result = scored(make_plan, recorder, Expectation("attack.release_delay", at_most=3))
    (window,) = result.nodes[0].attack.windows
    assert (window.detection_delay, window.release_delay, window.statements_after) == (1, None, 0)
    assert result.expectations[0].message == (
        "attack.release_delay at most 3: undefined for e1, no signal attack ended, or it published no attack "
        "probability"
    )


def test_an_onset_that_a_late_statement_never_reaches_is_not_called_missed(make_plan, recorder):
    play(recorder, signal={7: (1.0, 1.0)}, r=(0,) * 8, lag=1)
    result = scored(make_plan, recorder, Expectation("attack.detection_delay", at_least=0))
    (window,) = result.nodes[0].attack.windows
    assert (window.statements, window.detection_delay) == (0, None)
    assert result.expectations[0].measured is None
    assert "undefined" in result.expectations[0].message


def test_what_a_diverged_estimator_says_no_longer_counts_in_averages(make_plan, recorder):
    for step in range(4):
        recorder.truth(step, [0.0], (1.0,))
        diverged = step >= 2
        said = {"attack_probability": 0.25 * (step + 1), "a0": 1.5}
        recorder.estimate("e1", step, [] if diverged else [0.0], diverged=diverged, diagnostics=said)
    result = scored(make_plan, recorder, Expectation("attack.rmse", at_most=9), steps=4)
    assert result.nodes[0].attack.probability_on == pytest.approx(0.375)
    assert not result.expectations[0].passed


def test_expectations_name_estimators_and_leave_out_those_that_say_nothing(make_plan, recorder):
    play(recorder)
    play(recorder, r=None, node="e2")
    expectations = [
        Expectation("attack.probability_on", at_least=0.5),
        Expectation("attack.detection_delay", nodes=("e1",), equals=1),
        Expectation("attack.detection_delay", nodes=("e1", "e2"), equals=1),
    ]
    result = scored(make_plan, recorder, *expectations, nodes=("e1", "e2"))
    assert [outcome.passed for outcome in result.expectations] == [True, True, False]


def test_the_verdict_shows_what_was_known_of_the_attack(make_plan, recorder):
    play(recorder, value=lambda step: (3.0, 4.0))
    play(recorder, r=None, node="e2")
    stream = io.StringIO()
    print_verdict(scored(make_plan, recorder, nodes=("e1", "e2")), Console(file=stream, width=80))
    lines = [line.split() for line in stream.getvalue().splitlines()]
    assert ["e1", "0.567", "0.460", "2", "1", "1", "steps", "1", "steps", "2.31"] in lines
    assert not any(line[:1] == ["e2"] and "never" in line for line in lines)


def test_a_verdict_without_signal_attacks_does_not_speak_of_them(make_network):
    run = make_network(steps=30, nodes=3, attacked={})
    stream = io.StringIO()
    result = score(run.plan(), run.records(), state_groups={})
    print_verdict(result, Console(file=stream, width=80))
    assert "signal attack" not in stream.getvalue()
    assert all(node.attack is None for node in result.nodes)
