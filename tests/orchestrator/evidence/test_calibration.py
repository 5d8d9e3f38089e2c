"""The calibration of announced probabilities: sources whose error is known, and what their intervals hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from orchestrator.campaign.sweep import Request, prepare, sweep
from orchestrator.command_line.campaign_output import QuietProgress
from orchestrator.evidence.calibration import Calibration, attack_calibration, calibration, speaks_of_attacks
from orchestrator.evidence.columns import select
from orchestrator.evidence.sources import load_source

CALIBRATION = Path(__file__).parents[3] / "topologies" / "forti2019" / "calibration.yaml"

Told = tuple[np.ndarray, np.ndarray, np.ndarray]
"""What was announced, what happened, and in which trial."""


def sure_of_itself(rng: np.random.Generator, trials: int, steps: int, lasting: float = 0.0) -> Told:
    """Announce 0.9 where the chance is 0.7, and 0.1 where it is 0.3: the error is 0.2.

    ``lasting`` is the probability that a step has the luck of the step before it.
    """
    luck = rng.random((trials, steps))
    for k in range(1, steps):
        luck[:, k] = np.where(rng.random(trials) < lasting, luck[:, k - 1], luck[:, k])
    likely = rng.random((trials, steps)) < 0.5
    happened = luck < np.where(likely, 0.7, 0.3)
    trial = np.repeat(np.arange(trials), steps)
    return np.where(likely, 0.9, 0.1).ravel(), happened.ravel(), trial


def honest(rng: np.random.Generator, trials: int, steps: int) -> Told:
    """Announce the chance itself, anything from 0 to 1."""
    stated = rng.random((trials, steps))
    happened = rng.random((trials, steps)) < stated
    return stated.ravel(), happened.ravel(), np.repeat(np.arange(trials), steps)


def test_the_error_is_the_mean_distance_of_probability_and_frequency_by_bins() -> None:
    stated, happened, trial = honest(np.random.default_rng(1), 6, 50)
    found = calibration(stated, happened, trial, bins=7)
    expected = 0.0
    for i in range(7):
        inside = (stated >= i / 7) & (stated < (i + 1) / 7)
        expected += inside.mean() * abs(stated[inside].mean() - happened[inside].mean())
        assert found.count[i] == inside.sum()
        assert found.probability[i] == pytest.approx(stated[inside].mean())
        assert found.frequency.value[i] == pytest.approx(happened[inside].mean())
        assert found.frequency.low[i] < found.frequency.value[i] < found.frequency.high[i]
    assert found.error.value == pytest.approx(expected)
    assert found.trials == 6


def test_an_overconfident_source_errs_by_what_it_is_too_sure_which_one_bin_alone_does_not_show() -> None:
    told = sure_of_itself(np.random.default_rng(2), 50, 400)
    found = calibration(*told)
    assert found.error.value == pytest.approx(0.2, abs=6 * np.sqrt(0.21 / 20_000))
    assert found.error.low > 0.15
    assert found.frequency.value[[2, 18]] == pytest.approx([0.3, 0.7], abs=0.03)
    assert found.count.sum() == found.count[[2, 18]].sum() == 20_000
    assert np.isnan(found.probability).sum() == 18
    assert calibration(*told, bins=1).error.value < 0.02


def test_the_error_of_a_calibrated_source_is_that_of_chance() -> None:
    """Its mean is ``sqrt(2 / pi) sum sqrt(sum p (1 - p)) / N``; 200 runs, six deviations of their mean."""
    rng, errors, chance, expected = np.random.default_rng(3), [], [], []
    for _ in range(200):
        stated, happened, trial = honest(rng, 30, 40)
        found = calibration(stated, happened, trial)
        errors.append(found.error.value)
        chance.append(found.by_chance)
        variance = np.bincount((stated * 20).astype(int), stated * (1.0 - stated), minlength=20)
        expected.append(np.sqrt(2.0 / np.pi) * np.sqrt(variance).sum() / stated.size)
    reach = 6.0 * np.std(errors) / np.sqrt(200)
    assert np.mean(errors) == pytest.approx(np.mean(expected), abs=reach)
    assert np.mean(chance) == pytest.approx(np.mean(expected), rel=0.05)


def held(found: Calibration, truth: float) -> bool:
    return found.error.low <= truth <= found.error.high


def test_the_interval_begins_at_zero_as_often_as_it_says_when_the_source_is_calibrated() -> None:
    """The false-alarm rate of this test is below 1e-6; it leaves 97.5 % a little to few resamples."""
    rng, runs = np.random.default_rng(4), 300
    zero = sum(calibration(*honest(rng, 30, 40)).error.low == 0.0 for _ in range(runs))
    assert stats.binom.ppf(5e-7, runs, 0.95) <= zero


@pytest.mark.parametrize("lasting", [0.0, 0.9])
def test_the_interval_holds_the_error_where_luck_lasts_over_many_steps(lasting: float) -> None:
    """At least as often as it says; the false-alarm rate is below 1e-6, and 94 % are for 40 trials."""
    rng, runs = np.random.default_rng(5), 200
    found = [calibration(*sure_of_itself(rng, 40, 60, lasting)) for _ in range(runs)]
    assert stats.binom.ppf(1e-6, runs, 0.94) <= sum(held(own, 0.2) for own in found)
    widths = [own.error.high - own.error.low for own in found]
    assert np.median(widths) < (0.3 if lasting else 0.1)


def test_one_trial_has_an_error_and_no_interval_and_nothing_said_has_neither() -> None:
    alone = calibration(*honest(np.random.default_rng(6), 1, 30))
    assert 0.0 < alone.error.value < 0.5
    assert np.isnan([alone.error.low, alone.error.high, alone.by_chance]).all()
    nothing = calibration(np.zeros(0), np.zeros(0, dtype=bool), np.zeros(0, dtype=np.int64))
    assert np.isnan(nothing.error.value)
    assert (nothing.trials, nothing.count.sum()) == (0, 0)


def test_a_probability_that_is_none_counts_in_the_outermost_bin() -> None:
    found = calibration(np.array([1.5, -0.5, 1.0]), np.array([True, False, True]), np.array([0, 0, 1]))
    assert found.count[[0, 19]].tolist() == [1, 2]
    assert found.error.value == pytest.approx((0.5 + 0.5) / 3)


def test_over_a_campaign_scored_steps_before_any_divergence_count(tmp_path: Path) -> None:
    overrides = ("expect=null", "steps=60", "estimators.e3={method: kalman, sensors: [s1]}")
    request = Request(CALIBRATION, 4, overrides=overrides, out=tmp_path / "out")
    source = load_source(sweep(prepare(request), QuietProgress()))
    rows = select(source.table, nodes=["e1"])
    stated, on = rows.series("attack_probability"), rows.series("attack_on")
    found = attack_calibration(rows, 10)
    late = calibration(stated[:, 10:].ravel(), on[:, 10:].ravel() == 1.0, np.repeat(np.arange(4), 50))
    assert found.error == late.error
    assert found.count.sum() == 200
    mean_on = np.sum(stated[:, 10:] * on[:, 10:]) / on[:, 10:].sum()
    by_trial = rows.scalar("attack.probability_on")
    assert mean_on == pytest.approx(np.average(by_trial, weights=on[:, 10:].sum(axis=1)))
    ended = rows.table.set_column(
        rows.table.column_names.index("divergence_step"), "divergence_step", [[None, 30, 0, None]]
    )
    assert attack_calibration(select(ended, nodes=["e1"]), 10).count.sum() == 50 + 20 + 0 + 50
    assert speaks_of_attacks(rows)
    assert not speaks_of_attacks(select(source.table, nodes=["e3"]))
    assert not speaks_of_attacks(select(source.table.drop_columns(["attack_on"]), nodes=["e1"]))
