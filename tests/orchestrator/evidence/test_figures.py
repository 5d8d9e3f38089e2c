"""What a campaign shows, against the same figures worked out by hand from its rows."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from orchestrator.campaign.grid import GridError, lay_grid
from orchestrator.campaign.sweep import Request, prepare, sweep
from orchestrator.command_line.campaign_output import QuietProgress
from orchestrator.errors import InputError
from orchestrator.evidence.columns import ColumnError, Rows, select, state_groups
from orchestrator.evidence.consistency_of_rows import consistency
from orchestrator.evidence.detectors import delays, detection, judged_packets
from orchestrator.evidence.figures import (
    disagreement_curve,
    divergences,
    efficiency,
    rmse,
    rmse_curve,
    sent_rate,
)
from orchestrator.evidence.price import find_twins, price
from orchestrator.evidence.rows import failed_row
from orchestrator.evidence.samples import sample
from orchestrator.evidence.sources import Source, load_source
from orchestrator.evidence.table import schema, table
from orchestrator.evidence.timing import step_time
from orchestrator.run import RunReport
from orchestrator.topology.resolved import Topology
from tests.playing import RING

TOPOLOGY = (
    RING.format(name="small", seed=7, steps=40)
    + """\
  lone: {method: kalman, sensors: [s1, s3]}
  hub: {method: kalman, sensors: [s1, s2, s3], threshold: 9.0, on_alarm: reject}
channel:
  s*->lone: {bernoulli: {loss: 0.3}}
attacks:
  - {bias: {value: 1.0}, on: s2->*, steps: [20, 27]}
"""
)
TRIALS = 12


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Source:
    """A campaign of a topology and its unattacked twin."""
    directory = tmp_path_factory.mktemp("campaign")
    file = directory / "small.yaml"
    file.write_text(TOPOLOGY)
    request = Request(file, TRIALS, out=directory / "out", twins=True)
    return load_source(sweep(prepare(request), QuietProgress()))


def rows(campaign: Source, node: str, variant: int = 0) -> Rows:
    return select(campaign.table, variant=variant, nodes=[node])


def test_an_rmse_curve_is_the_root_mean_square_over_trials(campaign: Source) -> None:
    held = rows(campaign, "lone")
    error = held.series("error.position")
    assert error.shape == (TRIALS, 40)
    band = rmse_curve(held, "position")
    assert band.value == pytest.approx(np.sqrt(np.mean(error**2, axis=0)))
    assert np.all((band.low < band.value) & (band.value < band.high))
    whole = rmse(held, "position")
    assert whole.value == pytest.approx(np.sqrt(np.mean(error**2)))
    assert whole.low < whole.value < whole.high


def test_several_estimators_are_pooled_inside_their_trials(campaign: Source) -> None:
    network = select(campaign.table, variant=0, methods=["secure_distributed"])
    assert (network.trials, network.trial.size) == (TRIALS, 3 * TRIALS)
    error = network.series("error.state")
    assert rmse_curve(network, "state").value == pytest.approx(np.sqrt(np.mean(error**2, axis=0)))


def test_an_optimal_filter_is_consistent_white_and_as_good_as_its_bound(campaign: Source) -> None:
    held = rows(campaign, "lone")
    found = consistency(held)
    assert found.nees.all.judgement == found.nis.all.judgement == "consistent"
    assert found.whiteness.all.found.is_white(1 - 1e-3)
    assert not found.whiteness.all.from_nis
    assert found.nis.attacked.samples == 0  # no attack reached it
    efficient = efficiency(held, "state")
    assert (efficient.steps, efficient.refused, efficient.given) == (1.0, {}, ("own packets",))
    assert efficient.ratio.low < 1.0 < efficient.ratio.high


def test_consistency_is_split_by_attack(campaign: Source) -> None:
    found = consistency(rows(campaign, "e2"))
    assert found.nis.attacked.judgement == "overconfident"
    assert found.nis.attacked.samples == 8 * TRIALS
    assert found.nis.all.samples == found.nis.attacked.samples + found.nis.unattacked.samples
    refused = efficiency(rows(campaign, "e2"), "state")
    assert refused.steps == 0.5
    assert list(refused.refused) == ["from step 20 on: a packet was not as its sensor had sent it"]


def test_innovations_of_estimators_that_hear_different_numbers_of_sensors_keep_their_steps(
    campaign: Source,
) -> None:
    both = select(campaign.table, variant=1, nodes=["lone", "hub"])
    held = both.by_step("innovation", both.steps)
    assert held.shape == (2 * TRIALS, 40, 3)
    for row, node, flat in zip(
        held, both.text("node"), both.table.column("innovation").to_pylist(), strict=True
    ):
        own = np.array(flat, dtype=np.float64).reshape(40, 2 if node == "lone" else 3)
        assert np.array_equal(row[:, : own.shape[1]], own, equal_nan=True)
        assert np.isnan(row[:, own.shape[1] :]).all()


def test_of_several_estimators_the_least_white_is_told_as_the_least_of_so_many(campaign: Source) -> None:
    alone = {node: consistency(rows(campaign, node)).whiteness for node in ("lone", "hub", "e2")}
    together = consistency(select(campaign.table, variant=0, nodes=list(alone))).whiteness
    for where in ("all", "attacked", "unattacked"):
        p_values = {node: getattr(own, where).found.p_value for node, own in alone.items()}
        known = {node: value for node, value in p_values.items() if not np.isnan(value)}
        least = getattr(together, where)
        assert least.node == min(known, key=lambda node: known[node])
        assert least.found.p_value == pytest.approx(min(1.0, len(known) * min(known.values())))


def test_several_estimators_of_one_trial_have_no_verdict_together(run: RunReport) -> None:
    table = load_source(run.directory).table
    together, alone = consistency(select(table)), consistency(select(table, nodes=["lone"]))
    assert together.nees.all.judgement == together.nis.all.judgement == "unknown"
    assert alone.nis.all.judgement != "unknown"  # NIS of one is independent over steps
    assert together.nis.all.samples > alone.nis.all.samples


def test_detectors_are_told_by_rates_roc_and_delays(campaign: Source) -> None:
    held = rows(campaign, "hub")
    found = detection(held, points=6)
    statistic, attacked = held.flat("packet.statistic")[1], held.flat("packet.attacked")[1] == 1.0
    assert found.recall.value == pytest.approx(np.mean(statistic[attacked] >= 9.0))
    assert found.false_alarm_rate.value == pytest.approx(np.mean(statistic[~attacked] >= 9.0))
    between, rate = found.between_false_alarms, found.false_alarm_rate
    assert (between.value, between.low) == pytest.approx((1.0 / rate.value, 1.0 / rate.high))
    assert found.roc.area.value > 0.9
    assert found.roc.unit == "trials"
    assert judged_packets(held).statistic.size == 3 * 40 * TRIALS
    measured = held.flat("window.delay")[1]
    assert delays(held).windows == TRIALS
    assert delays(held).found == int(np.sum(~np.isnan(measured)))
    assert found.delay.restricted_mean.value == pytest.approx(delays(held).restricted_mean.value)


def test_without_a_false_alarm_the_time_between_two_has_a_lower_bound(campaign: Source) -> None:
    held = rows(campaign, "hub")
    place = held.table.column_names.index("packet.alarm")
    silent = [[False] * len(alarms) for alarms in held.table["packet.alarm"].to_pylist()]
    found = detection(replace(held, table=held.table.set_column(place, "packet.alarm", [silent])), points=2)
    low = 1.0 / (1.0 - 0.05 ** (1.0 / (TRIALS - 1)))
    between = found.between_false_alarms
    assert (between.value, between.low, between.high) == pytest.approx((np.inf, low, np.inf))


def test_disagreement_divergence_and_communication_are_told(campaign: Source) -> None:
    network = select(campaign.table, variant=0, methods=["secure_distributed"])
    apart = rows(campaign, "e1").series("disagreement_by_step")
    assert disagreement_curve(network).value == pytest.approx(np.sqrt(np.mean(apart**2, axis=0)))
    assert (divergences(network).value, divergences(network).low) == (0.0, 0.0)
    assert divergences(network).high == pytest.approx(0.2425, abs=1e-4)  # Wilson: 0 of 12
    assert sent_rate(network).value == 1.0  # nobody keeps quiet here


def test_the_price_of_an_attack_is_what_the_twin_does_not_pay(campaign: Source) -> None:
    assert find_twins(campaign.documents) == {0: 1}
    hit = price(rows(campaign, "e2"), rows(campaign, "e2", 1), "rmse.position")
    assert hit.difference.shift.low > 0.0
    assert hit.relative > 1.0
    direct = rows(campaign, "e2").scalar("rmse.position") - rows(campaign, "e2", 1).scalar("rmse.position")
    assert hit.by_trial == pytest.approx(direct.tolist())
    spared = price(rows(campaign, "lone"), rows(campaign, "lone", 1), "rmse.position")
    assert spared.difference.identical  # common random numbers: what nobody attacked does not change at all


def test_twins_follow_each_variant_and_need_attacks(tmp_path: Path) -> None:
    grid = lay_grid(["a=1,2", "b=3"], twins=True)
    assert [own.settings for own in grid] == [
        {"a": "1", "attacks": "as given"},
        {"a": "1", "attacks": "null"},
        {"a": "2", "attacks": "as given"},
        {"a": "2", "attacks": "null"},
    ]
    assert [own.overrides[-1] for own in grid] == ["b=3", "attacks=null"] * 2
    with pytest.raises(GridError, match="several values already"):
        lay_grid(["attacks=null,[]"], twins=True)
    file = tmp_path / "calm.yaml"
    file.write_text(TOPOLOGY.partition("attacks:")[0])
    with pytest.raises(InputError, match="has no attacks"):
        prepare(Request(file, 1, twins=True))


def test_the_time_of_a_step_is_told(campaign: Source, run: RunReport) -> None:
    found = step_time(campaign, 1)
    assert found.trials == TRIALS
    assert 0.0 < found.p50_s <= found.p95_s < 10.0
    single = step_time(load_source(run.directory))
    told = json.loads((run.directory / "timing.json").read_bytes())
    assert (single.p50_s, single.p95_s, single.trials) == (
        told["step_time_p50_s"],
        told["step_time_p95_s"],
        1,
    )


def test_one_run_goes_through_the_same_figures(run: RunReport) -> None:
    held = select(load_source(run.directory).table, nodes=["lone"])
    assert held.trials == 1
    band = rmse_curve(held, "position")
    assert band.value.size == 24
    assert np.isnan(band.low).all()  # one trial has no interval
    assert consistency(held).nees.all.judgement == "unknown"
    assert state_groups(held.table) == ["acceleration", "position", "state", "velocity"]


def test_trials_that_all_failed_show_nothing_and_break_nothing(small: Topology) -> None:
    failed = [failed_row(replace(small.plan, trial=trial), "no") for trial in range(3)]
    held = select(table(failed, schema(small.state_groups)))
    assert (held.trials, held.failed.tolist()) == (3, [True] * 3)
    assert np.isnan(rmse(held, "position").value)
    assert rmse_curve(held, "position").value.size == 0
    assert consistency(held).nis.all.judgement == "unknown"
    assert detection(held).delay.windows == 0
    assert np.isinf(sample(held, "rmse.position").values).all()


def test_what_is_not_there_is_named_with_what_is(campaign: Source) -> None:
    with pytest.raises(ColumnError, match=r"variants \[0, 1\]; name one"):
        select(campaign.table)
    with pytest.raises(ColumnError, match="no node e9; there is e1, e2"):
        select(campaign.table, variant=0, nodes=["e9"])
