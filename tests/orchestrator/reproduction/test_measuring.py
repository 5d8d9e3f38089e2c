"""The numbers beside a paper's, and what they say of it."""

import math

import numpy as np
import pytest

from orchestrator.evidence.intervals import Interval
from orchestrator.reproduction.claims import Value
from orchestrator.reproduction.judging import Word, why_open, word_on
from orchestrator.reproduction.measuring import FEWEST, RANGED, Found, over_trials


def test_each_statistic_is_that_of_the_trials_in_which_the_metric_is_defined():
    values = np.array([1.0, 2.0, np.nan, 4.0, 9.0])
    assert over_trials(values, "median").number.value == 3.0
    assert over_trials(values, "mean").number.value == 4.0
    assert over_trials(values, "rms").number.value == pytest.approx(math.sqrt(102.0 / 4.0))
    assert over_trials(values, "max").number.value == 9.0
    assert over_trials(values, "share", above=1.5).number.value == 0.75
    assert over_trials(values, "median").trials == 4
    assert over_trials(np.array([np.nan]), "mean").trials == 0


def test_an_error_without_bound_makes_mean_and_rms_unbounded_and_leaves_the_median():
    values = np.array([1.0, 2.0, math.inf])
    assert over_trials(values, "rms").number.value == math.inf
    assert over_trials(values, "mean").number.value == math.inf
    assert over_trials(values, "median").number.value == 2.0


def test_a_run_whose_estimator_diverged_is_among_those_above_any_limit_and_a_failed_one_is_in_no_share():
    final = np.array([0.3, 7.0, math.inf, np.nan])
    found = over_trials(final, "share", above=5.0)
    assert (found.number.value, found.trials) == (pytest.approx(2 / 3), 3)


@pytest.mark.parametrize("statistic", ["median", "mean", "rms"])
def test_intervals_hold_the_truth_as_often_as_they_say(statistic):
    """400 campaigns of 40 trials; 0.90 to 0.98 is left by one of 95 % about once in ten thousand times."""
    rng = np.random.default_rng(0)
    truth = {"median": 5.0, "mean": 5.0, "rms": math.sqrt(26.0)}[statistic]
    held = sum(over_trials(rng.normal(5.0, 1.0, 40), statistic).number.holds(truth) for _ in range(400))
    assert 0.90 <= held / 400 <= 0.98


@pytest.mark.parametrize("statistic", ["mean", "rms"])
@pytest.mark.parametrize("trials", [FEWEST, 10])
def test_intervals_of_few_trials_hold_as_often_as_they_say(statistic: str, trials: int) -> None:
    """1,000 campaigns; 0.92 to 0.98 is left by one of 95 % less than once in ten thousand times."""
    rng = np.random.default_rng(2)
    truth = {"mean": 5.0, "rms": math.sqrt(26.0)}[statistic]
    held = sum(over_trials(rng.normal(5.0, 1.0, trials), statistic).number.holds(truth) for _ in range(1000))
    assert 0.92 <= held / 1000 <= 0.98


@pytest.mark.parametrize("statistic", ["median", "mean", "rms"])
def test_too_few_trials_have_no_interval_and_few_no_range(statistic: str) -> None:
    values = np.random.default_rng(3).normal(5.0, 1.0, RANGED)
    few, some, enough = (over_trials(values[:size], statistic) for size in (FEWEST - 1, RANGED - 1, RANGED))
    assert np.isnan([few.number.low, few.number.high, *few.range]).all()
    assert np.isfinite([some.number.low, some.number.high]).all()
    assert np.isnan(some.range).all()
    assert enough.range == (values.min(), values.max())


def test_a_rate_that_was_never_anything_but_0_is_not_certain_to_be() -> None:
    """Of 20 trials alike, 1 - 0.05^(1/19) may differ."""
    never = over_trials(np.zeros(20), "mean", is_share=True).number
    assert (never.value, never.low, never.high) == (0.0, 0.0, pytest.approx(1.0 - 0.05 ** (1.0 / 19.0)))
    always = over_trials(np.ones(20), "mean", is_share=True).number
    assert (always.low, always.high) == (pytest.approx(0.05 ** (1.0 / 19.0)), 1.0)
    rare = over_trials(np.array([0.01, *np.zeros(19)]), "mean", is_share=True).number
    assert rare.low == 0.0 < rare.high < 0.01, "Student's interval reaches below 0"
    assert over_trials(np.full(20, 6.0), "mean").number == Interval(6.0, 6.0, 6.0), "a count is no share"


def test_the_root_mean_square_of_nothing_but_zeros_is_zero() -> None:
    assert over_trials(np.zeros(20), "rms").number == Interval(0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("statistic", "values", "claim", "word", "why"),
    [
        ("mean", [0.0, 0.0], {"paper": 0.0}, Word.OPEN, "fewer than 10 trials"),
        ("mean", [0.978, 0.979], {"paper": "most", "at_least": 0.9}, Word.OPEN, "fewer than 6 trials"),
        ("mean", [1.0, 2.0], {"paper": 1.5}, Word.OPEN, "fewer than 10 trials"),
        ("share", [1.0, 1.0], {"paper": "most", "at_least": 0.3}, Word.OPEN, "fewer than 6 trials"),
        ("max", [1.0, 2.0], {"paper": "small", "at_most": 3.0}, Word.OPEN, "fewer than 6 trials"),
        ("max", [1.0, 4.0], {"paper": "small", "at_most": 3.0}, Word.FAILS, ""),
        ("mean", [1.0, 1.1, 0.9, 1.0, 1.2, 0.8], {"paper": 9.0}, Word.OPEN, "fewer than 10 trials"),
        ("mean", [1.0, 1.1, 0.9, 1.0, 1.2, 0.8], {"paper": 1.05}, Word.AGREES, ""),
    ],
)
def test_a_claim_is_open_for_want_of_trials_and_the_page_says_how_many(
    statistic: str, values: list[float], claim: dict[str, object], word: Word, why: str
) -> None:
    value = Value(label="x", campaign="c", metric="m", statistic=statistic, **claim)
    found = over_trials(np.array(values), statistic)
    assert word_on(value, found) is word
    assert word is not Word.OPEN or why_open(value, found) == why


def test_the_range_holds_most_single_trials():
    low, high = over_trials(np.random.default_rng(1).uniform(0.0, 1.0, 2000), "median").range
    assert (low, high) == (pytest.approx(0.05, abs=0.02), pytest.approx(0.95, abs=0.02))


@pytest.mark.parametrize(
    ("paper", "bounds", "number", "word"),
    [
        (2.0, {}, Interval(2.1, 1.9, 2.3), Word.AGREES),
        (2.5, {}, Interval(2.1, 1.9, 2.3), Word.AS_ONE_RUN),
        (9.0, {}, Interval(2.1, 1.9, 2.3), Word.DIFFERS),
        (9.0, {}, Interval(2.1, math.nan, math.nan), Word.OPEN),
        ("small", {"at_most": 3.0}, Interval(2.1, 1.9, 2.3), Word.HOLDS),
        ("small", {"at_most": 2.2}, Interval(2.1, 1.9, 2.3), Word.OPEN),
        ("small", {"at_most": 1.0}, Interval(2.1, 1.9, 2.3), Word.FAILS),
        ("large", {"at_least": 3.0}, Interval(2.1, 1.9, 2.3), Word.FAILS),
        ("small", {"at_most": 3.0}, Interval(2.1, math.nan, math.nan), Word.OPEN),
        ("small", {"at_most": 1.0}, Interval(2.1, math.nan, math.nan), Word.OPEN),
        ("small", {}, Interval(2.1, 1.9, 2.3), Word.NOTHING),
        (2.0, {}, Interval(math.nan, math.nan, math.nan), Word.NOTHING),
    ],
)
def test_the_verdict_on_a_claim(paper, bounds, number, word):
    value = Value(label="x", campaign="c", metric="m", paper=paper, **bounds)
    assert word_on(value, Found(number, (1.0, 3.0), 20)) is word
