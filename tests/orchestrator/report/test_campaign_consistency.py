"""What the page of many trials says of consistency, and what it must not say of survivors."""

from __future__ import annotations

from pathlib import Path

import pytest

from orchestrator.campaign.sweep import Request, prepare, sweep
from orchestrator.command_line.campaign_output import QuietProgress
from orchestrator.evidence.chosen import choose
from orchestrator.report.campaign_consistency import consistency_table
from orchestrator.report.campaign_tables import error_table
from orchestrator.report.contents import Table
from orchestrator.report.grouping import find_groups

pytest.importorskip("pyarrow", reason="campaigns are an extra")

SHARED = """
name: shared
seed: 3
steps: 60
period_s: 0.1
plant: {model: linear, A: [[0.95]], process_noise: {std: 0.3}, initial: {std: 1.0}}
sensors: {s1..s3: {model: linear, C: [[1.0]], noise: {std: 0.15}}}
"""

NO_COVARIANCE = """
from nodes.contract import Belief
from nodes.estimators.kalman import Kalman


class Mostly(Kalman):
    def estimate(self, step):
        own = super().estimate(step)
        return Belief(state=own.state, covariance=own.covariance * (1.0 if step % 20 == 0 else -1.0))
"""


def tables(directory: Path, estimators: str, trials: int, *overrides: str) -> tuple[Table, Table]:
    """Return what a campaign's page says of errors and of consistency."""
    (directory / "shared.yaml").write_text(f"{SHARED}estimators: {estimators}\n")
    request = Request(directory / "shared.yaml", trials, overrides=overrides, out=directory / "out")
    groups = find_groups([choose(sweep(prepare(request), QuietProgress()))], None, [])
    return error_table(groups), consistency_table(groups)


def verdicts(found: Table) -> dict[str, str]:
    return {row[1]: row[4].text for row in found.rows}


def test_optimal_filters_of_one_plant_are_consistent_and_white_together(tmp_path: Path) -> None:
    errors, found = tables(tmp_path, "{e1..e3: {method: kalman}}", 8)
    assert "left out" not in errors.columns
    assert verdicts(found) == {"NEES": "consistent", "NIS": "consistent"}
    white = found.rows[1][7]
    assert white.startswith("yes (e")
    assert "NIS" not in white  # innovations were there


def test_consistency_is_no_verdict_where_only_survivors_are_left(tmp_path: Path) -> None:
    errors, found = tables(tmp_path, "{e1: {method: kalman}}", 12, "score={divergence_bound: 0.42}")
    lost = errors.rows[0][-1]
    assert lost.endswith(" of 12 diverged")
    count = lost.split()[0]
    assert 0 < int(count) < 12
    assert verdicts(found)["NEES"] == f"unknown: {count} of 12 trials diverged"


def test_estimates_without_a_covariance_that_is_one_forbid_the_verdict(tmp_path: Path) -> None:
    (tmp_path / "mostly.py").write_text(NO_COVARIANCE)
    _, found = tables(tmp_path, '{e1: {method: "./mostly.py:Mostly", sensors: [s1]}}', 12)
    assert verdicts(found)["NEES"] == "unknown: 95 % of the covariances are none"


def test_what_is_sent_because_it_surprises_is_not_judged_by_its_innovations(tmp_path: Path) -> None:
    sends = "sensors.s1.send={send_on_delta: {threshold: 0.2}}"
    _, found = tables(tmp_path, "{e1: {method: kalman, sensors: [s1]}}", 4, sends)
    assert verdicts(found)["NIS"] == "not judged: sent because it surprises"
    assert found.rows[1][7] == "-"
