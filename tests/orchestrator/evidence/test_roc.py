"""ROC, its area and the cost of a threshold against definitions, and how often intervals hold the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.special import expit, logit

from orchestrator.evidence.operating import (
    Judged,
    Windows,
    between_false_alarms,
    operating_curve,
)
from orchestrator.evidence.pareto import pareto_front
from orchestrator.evidence.roc import roc


def test_the_area_is_the_share_of_pairs_in_the_right_order() -> None:
    rng = np.random.default_rng(1)
    statistic = rng.integers(0, 8, 60).astype(float)  # with ties
    attacked = rng.random(60) < 0.4
    pairs = [np.sign(x - y) for x in statistic[attacked] for y in statistic[~attacked]]
    found = roc(statistic, attacked)
    assert found.area.value == pytest.approx((np.mean(pairs) + 1) / 2, abs=1e-14)
    by_trapezes = np.trapezoid(found.detection_rate, found.false_alarm_rate)
    assert by_trapezes == pytest.approx(found.area.value, abs=1e-14)


def test_a_point_of_the_curve_is_the_share_that_reaches_the_threshold() -> None:
    rng = np.random.default_rng(2)
    statistic, attacked = rng.integers(0, 5, 40).astype(float), rng.random(40) < 0.5
    found = roc(statistic, attacked)
    for threshold, false_alarms, detections in zip(
        found.threshold, found.false_alarm_rate, found.detection_rate, strict=True
    ):
        assert false_alarms == pytest.approx(np.mean(statistic[~attacked] >= threshold))
        assert detections == pytest.approx(np.mean(statistic[attacked] >= threshold))


def test_the_interval_of_one_trial_is_delongs() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.normal(1.0, 1.0, 25), rng.normal(0.0, 1.0, 40)
    order = np.array([[(a > b) + 0.5 * (a == b) for b in y] for a in x])
    area = order.mean()
    variance = order.mean(axis=1).var(ddof=1) / 25 + order.mean(axis=0).var(ddof=1) / 40
    # clusters of one packet: the cross term is a product of the two means of deviations, about zero
    attacked = np.arange(65) < 25
    found = roc(np.concatenate([x, y]), attacked).area
    reach = stats.norm.ppf(0.975) * np.sqrt(variance) / (area * (1 - area))
    assert found.value == pytest.approx(area)
    assert found.low == pytest.approx(expit(logit(area) - reach), rel=1e-9)
    assert found.high == pytest.approx(expit(logit(area) + reach), rel=1e-9)


def test_the_interval_by_trials_holds_the_truth_where_packets_are_correlated() -> None:
    """The false-alarm rate of this test is below 1e-6; taken for independent, packets would mislead."""
    rng, runs, by_trial, by_packet = np.random.default_rng(4), 300, 0, 0
    truth = stats.norm.cdf(1.0 / np.sqrt(2.0))
    trial = np.repeat(np.arange(40), 10)
    attacked = np.tile(np.arange(10) < 4, 40)
    for _ in range(runs):
        statistic = np.sqrt(0.7) * rng.normal(size=40)[trial] + np.sqrt(0.3) * rng.normal(size=400)
        statistic = np.where(attacked, 1.0 + statistic, np.sqrt(0.7) * rng.normal(size=40)[trial])
        statistic[~attacked] += np.sqrt(0.3) * rng.normal(size=240)
        by_trial += roc(statistic, attacked, trial).area.holds(truth)
        by_packet += roc(statistic, attacked).area.holds(truth)
    assert stats.binom.ppf(5e-7, runs, 0.93) <= by_trial <= stats.binom.ppf(1 - 5e-7, runs, 0.97)
    assert by_packet < 0.85 * runs


def test_a_useless_detector_has_an_area_of_one_half_and_a_perfect_one_of_one() -> None:
    attacked = np.arange(20) < 10
    assert roc(np.ones(20), attacked).area.value == 0.5
    assert roc(attacked.astype(float), attacked).area.value == 1.0
    assert np.isnan(roc(np.ones(3), np.ones(3, dtype=bool)).area.value)


def recorded(rng: np.random.Generator) -> tuple[Judged, Windows]:
    """Return 20 trials of 2 links with 50 steps; link 1 is attacked from step 30 to 39, shifted by 2."""
    trial, link, step = (part.ravel() for part in np.mgrid[:20, :2, :50])
    attacked = (link == 1) & (step >= 30) & (step < 40)
    statistic = rng.normal(size=trial.size) + 2.0 * attacked
    windows = Windows(np.arange(20), np.ones(20, int), np.full(20, 30), np.full(20, 39))
    return Judged(trial, link, step, statistic, attacked), windows


def test_delays_at_a_threshold_are_those_of_the_first_packet_that_reaches_it() -> None:
    judged, windows = recorded(np.random.default_rng(5))
    curve = operating_curve(judged, windows, points=4, resamples=20)
    assert len(curve) == 5
    for point in curve:
        reached = [
            judged.statistic[(judged.trial == t) & judged.attacked] >= point.threshold for t in range(20)
        ]
        delays = np.array([own.argmax() if own.any() else 10 for own in reached])
        assert point.delay.found == sum(own.any() for own in reached)
        assert point.delay.survival == pytest.approx([np.mean(delays > t) for t in range(10)])


def test_intervals_of_the_curve_have_the_confidence_that_was_asked_for() -> None:
    judged, windows = recorded(np.random.default_rng(8))
    wide, narrow = (
        operating_curve(judged, windows, points=3, confidence=confidence, resamples=200)[1].delay
        for confidence in (0.99, 0.5)
    )
    assert wide.restricted_mean.low < narrow.restricted_mean.low
    assert narrow.restricted_mean.high < wide.restricted_mean.high


def test_a_stricter_threshold_buys_rarer_false_alarms_with_later_detections() -> None:
    judged, windows = recorded(np.random.default_rng(6))
    curve = operating_curve(judged, windows, points=8, resamples=50)
    rarity = [point.between_false_alarms for point in curve]
    delay = [point.delay.restricted_mean.value for point in curve]
    assert rarity == sorted(rarity)
    assert delay == sorted(delay)
    assert rarity[0] == pytest.approx(1.0)
    assert rarity[-1] == np.inf
    genuine = judged.statistic[~judged.attacked]
    assert between_false_alarms(judged, 2.0) == pytest.approx(genuine.size / np.sum(genuine >= 2.0))


def test_the_front_holds_what_nobody_beats() -> None:
    cost = np.array([1.0, 2.0, 2.0, 3.0, 4.0, np.nan, 0.5])
    error = np.array([5.0, 3.0, 4.0, 3.0, 1.0, 0.0, np.inf])
    assert pareto_front(cost, error).tolist() == [True, True, False, False, True, False, False]
    assert pareto_front(np.ones(2), np.ones(2)).all()  # equals do not beat each other
