"""What a summary tells of a campaign's results, written here row by row, and what its table shows."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from orchestrator.campaign.summary import Summary, summarise, tally
from orchestrator.command_line.campaign_output import print_summary
from orchestrator.evidence.intervals import share
from orchestrator.evidence.rates import pooled_rate
from orchestrator.evidence.rows import FAILED, SCORED
from orchestrator.evidence.sources import RESULTS
from orchestrator.evidence.table import schema, table


def row(trial: int, node: str, **values: Any) -> dict[str, Any]:
    """Return the row of an estimator, without an attack and with one genuine packet unless told otherwise."""
    packets = {"packet.attacked": [False], "packet.alarm": [False]}
    facts = {"variant": 0, "trial": trial, "seed": 1, "node": node, "method": "kalman", "status": SCORED}
    own = {"message": "", "passed": True, "privileged": "", "rmse.state": 1.0, "divergences": 0.0}
    return {**facts, **own, **packets, **values}


def summary_of(folder: Path, rows: list[dict[str, Any]], confidence: tuple[float, ...] = ()) -> Summary:
    pq.write_table(table(rows, schema([])), folder / RESULTS, row_group_size=3)
    return summarise(folder, confidence)


def shown(summary: Summary) -> str:
    """Return what people read."""
    console = Console(width=160, highlight=False)
    with console.capture() as captured:
        print_summary(summary, console)
    return captured.get()


def test_divergences_are_told_by_the_number_of_trials_and_not_by_their_median(tmp_path: Path) -> None:
    rows = []
    for trial in range(100):
        lost = trial % 7 == 3
        figures = {"divergences": float(lost), "rmse.state": math.inf if lost else 1.0}
        rows += [row(trial, "e1", **figures), row(trial, "e2")]
    summary = summary_of(tmp_path, rows)
    facts = summary.lines[0].figures["divergences"].facts()
    expected = share(14, 100)
    assert (facts["with"], facts["trials"], facts["share"]) == (14, 100, 0.14)
    assert (facts["low"], facts["high"]) == (expected.low, expected.high)
    assert summary.lines[1].figures["divergences"].events == 0
    table_shown = shown(summary)
    assert "trials diverged" in table_shown
    assert "14 of 100" in table_shown
    assert "0 of 100" in table_shown


def test_several_estimators_of_a_method_that_diverge_in_one_trial_are_one_trial(tmp_path: Path) -> None:
    rows = [
        row(trial, f"e{node}", divergences=float(trial == 2 and node < 4))
        for trial in range(8)
        for node in range(7)
    ]
    (line,) = summary_of(tmp_path, rows).lines
    assert (line.who, line.figures["divergences"].events) == ("kalman (7)", 1)


def test_rates_of_detectors_are_of_all_packets_and_not_medians_of_trials(tmp_path: Path) -> None:
    """One trial in four has a false alarm, and some have more packets: the median of their rates is 0."""
    rng, rows, alarms, genuine = np.random.default_rng(5), [], [], []
    for trial in range(20):
        attacked = np.arange(6 + trial % 3) < 2
        alarm = (rng.random(attacked.size) < 0.6) & attacked
        alarm[-1] |= trial % 4 == 0
        packets = {"packet.attacked": attacked.tolist(), "packet.alarm": alarm.tolist()}
        medians = {"detector.recall": alarm[attacked].mean(), "detector.false_alarm_rate": 0.0}
        rows.append(row(trial, "e1", **packets, **medians))
        alarms.append((alarm[attacked].sum(), alarm[~attacked].sum()))
        genuine.append((attacked.sum(), (~attacked).sum()))
    summary = summary_of(tmp_path, rows)
    found = summary.lines[0].figures
    rejected, packets = np.array(alarms, dtype=float), np.array(genuine, dtype=float)
    band = pooled_rate(rejected, packets)
    for k, name in enumerate(("detector.recall", "detector.false_alarm_rate")):
        facts = found[name].facts()
        assert facts["rate"] == pytest.approx(rejected[:, k].sum() / packets[:, k].sum())
        assert (facts["rejected"], facts["packets"]) == (rejected[:, k].sum(), packets[:, k].sum())
        assert (facts["low"], facts["high"]) == (band.low[k], band.high[k])
    assert found["detector.false_alarm_rate"].events == 5
    assert f"{100 * found['detector.false_alarm_rate'].value.value:.3g} %" in shown(summary)
    assert "rejected: share of the packets of all trials" in shown(summary)


def test_where_no_packet_was_attacked_there_is_no_rate_of_attacked_ones(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, [row(trial, "e1") for trial in range(3)])
    assert "detector.recall" not in summary.metrics
    assert "attacked rejected" not in shown(summary)


def test_failed_trials_are_counted_and_are_in_no_figure(tmp_path: Path) -> None:
    rows = [row(trial, "e1") for trial in range(4)]
    failed = {
        "variant": 0,
        "trial": 4,
        "seed": 1,
        "node": "",
        "method": "",
        "status": FAILED,
        "message": "no",
    }
    summary = summary_of(tmp_path, [*rows, failed])
    assert (summary.failed, summary.tallies[0].trials) == (1, 5)
    assert summary.lines[0].figures["divergences"].trials == 4
    assert tally(tmp_path) == summary.tallies


def test_intervals_have_the_confidence_of_their_variant(tmp_path: Path) -> None:
    values = np.arange(20.0)
    rows = [
        {**row(trial, "e1"), "variant": variant, "rmse.state": values[trial]}
        for variant in range(2)
        for trial in range(20)
    ]
    summary = summary_of(tmp_path, rows, (0.95, 0.5))
    wide, narrow = (line.figures["rmse.state"].value for line in summary.lines)
    assert wide.low < narrow.low < narrow.high < wide.high
    assert [own["confidence"] for own in summary.facts()["variants"]] == [0.95, 0.5]
    assert "medians over trials with intervals" in shown(summary)
    assert "with 50 % intervals" in shown(summary_of(tmp_path, rows[:20], (0.5,)))


def test_a_figure_without_bound_stays_so(tmp_path: Path) -> None:
    rows = [row(trial, "e1", **{"rmse.state": math.inf}) for trial in range(3)]
    facts = summary_of(tmp_path, rows).lines[0].figures["rmse.state"].facts()
    assert (facts["median"], facts["low"], facts["trials"]) == ("unbounded", None, 3)
