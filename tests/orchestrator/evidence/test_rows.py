from __future__ import annotations

import math

import numpy as np
import pytest

from bus.messages import Estimate
from orchestrator.evidence.rows import failed_row, trial_rows
from orchestrator.evidence.table import columns, schema, table
from orchestrator.score.results import Score
from orchestrator.score.scoring import score


@pytest.fixture(scope="module")
def rows(logged, records):
    return {row["node"]: row for row in trial_rows(logged, records)}


@pytest.fixture(scope="module")
def scored(logged, records) -> Score:
    return score(
        logged.plan, records, state_groups=logged.state_groups, options=logged.score_options, expectations=()
    )


def test_every_estimator_has_one_row_with_the_scores_own_figures(rows, scored):
    assert list(rows) == ["e1", "e2", "e3", "lone"]
    for node in scored.nodes:
        row = rows[node.name]
        assert (row["variant"], row["trial"], row["seed"], row["status"]) == (0, 0, 7, "scored")
        assert row["method"] == node.method
        assert row["rmse.position"] == node.groups["position"].rmse
        assert row["rmse_attacked.state"] == node.groups["state"].attacked
        assert row["nees.mean"] == node.nees.mean
        assert row["nis.inside"] == node.nis.inside
    assert rows["e1"]["network"] != rows["lone"]["network"]
    assert rows["e1"]["disagreement"] == scored.networks[rows["e1"]["network"]].disagreement
    assert rows["lone"]["disagreement"] is None


def test_link_metrics_are_over_the_links_that_enter_the_node(rows, scored):
    entering = [link.traffic for link in scored.links if link.destination == "lone"]
    assert rows["lone"]["packets.sent"] == sum(traffic.sent for traffic in entering) == 48
    assert rows["lone"]["packets.lost"] == sum(traffic.lost for traffic in entering) > 0


def test_series_have_an_entry_a_step_and_agree_with_the_score(rows, scored):
    for node in scored.nodes:
        row = rows[node.name]
        assert row["error.state"].tolist() == node.error["state"]
        counted = row["nees"][4:]
        assert float(np.mean(counted)) == pytest.approx(node.nees.mean)
        assert row["nis"].shape == row["attacked"].shape == row["sent"].shape == (24,)
        assert int(row["attacked"].sum()) == node.attacked_steps


def test_who_sends_for_a_node_is_counted_step_by_step(rows):
    assert rows["e1"]["slots"] == 2  # its sensor's slot and its own
    assert rows["e1"]["sent"].tolist() == [2] * 24
    assert rows["lone"]["slots"] == 2  # two sensors, and nobody hears the node itself
    assert rows["lone"]["sent"].tolist() == [2] * 24


def test_judged_packets_give_the_scores_confusion(rows, scored, records):
    by_link = {link.name: link.detector for link in scored.links}
    row = rows["e2"]
    mine = row["packet.link"] == "s2->e2"
    attacked, alarm = row["packet.attacked"][mine], row["packet.alarm"][mine]
    confusion = by_link["s2->e2"]
    assert confusion is not None
    assert int((attacked & alarm).sum()) == confusion.true_positive > 0
    assert int((~attacked & alarm).sum()) == confusion.false_positive
    stated = [
        m.detector_statistic[0] for topic, m in records if isinstance(m, Estimate) and topic.endswith("e2")
    ]
    assert row["packet.statistic"][mine].tolist() == stated


def test_attack_windows_tell_their_delay_and_when_they_are_censored(rows, scored):
    (window,) = scored.windows
    row = rows["e2"]
    assert row["window.link"] == ["s2->e2"]
    assert (row["window.first"], row["window.last"], row["window.end"]) == ([10], [15], [17])
    delay = math.nan if window.delay is None else window.delay
    assert row["window.delay"] == pytest.approx([delay], nan_ok=True)
    assert rows["lone"]["window.link"] == []


def test_a_table_has_all_columns_whatever_the_rows_hold(logged, records):
    groups = logged.state_groups
    full = table(trial_rows(logged, records), schema(groups, ["steps"]))
    failed = table([failed_row(logged.plan, "no")], schema(groups, ["steps"]))
    assert full.schema == failed.schema
    assert full.column_names == list(columns(groups, ["steps"]))
    full.validate(full=True)
    failed.validate(full=True)
    assert failed["status"].to_pylist() == ["failed"]
    assert failed["error.state"].to_pylist() == [None]
    assert failed["rmse.state"].to_pylist() == [None]


def test_nothing_is_null_and_unbounded_is_infinite_in_a_table(logged, records):
    row = trial_rows(logged, records)[0] | {"rmse.state": math.inf, "nees": np.array([np.nan, 2.0])}
    got = table([row], schema(logged.state_groups))
    assert got["rmse.state"].to_pylist() == [math.inf]
    assert got["nees"].to_pylist() == [[None, 2.0]]
