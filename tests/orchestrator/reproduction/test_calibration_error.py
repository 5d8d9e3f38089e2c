"""The calibration error as a number beside a paper's: that of the evidence, over all trials together."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from orchestrator.campaign.sweep import sweep
from orchestrator.command_line.campaign_output import QuietProgress
from orchestrator.evidence.calibration import attack_calibration
from orchestrator.evidence.columns import select
from orchestrator.report.contents import Figure
from orchestrator.reproduction.blocks import blocks_of
from orchestrator.reproduction.claims import Value
from orchestrator.reproduction.errors import ReproduceError
from orchestrator.reproduction.judging import Word, word_on
from orchestrator.reproduction.listing import read_listing
from orchestrator.reproduction.measuring import Results, number, over_what_varies

TOPOLOGY = Path(__file__).parents[3] / "topologies" / "forti2019" / "calibration.yaml"
LIST = f"""
[sure]
file = "{TOPOLOGY}"
trials = 6
set = ["expect=null", "steps=50"]

[[figure]]
name = "Calibration"
about = "whether a probability is one"
campaign = "sure"
metric = "attack_probability"
statistic = "calibration_error"
values = [{{label = "first", node = "e1", paper = "a probability", at_most = 0.9}}]
points = [{{label = "each", each = ["e2", "e1"], x = [2, 1]}}]
"""


def test_it_is_that_of_the_evidence_from_the_first_step_that_counts_on(tmp_path: Path) -> None:
    (tmp_path / "reproduce.toml").write_text(LIST)
    listing = read_listing(tmp_path, tmp_path / "out")
    sweep(listing.campaigns[0].campaign, QuietProgress())
    results = Results({"sure": tmp_path / "out" / "sure"})
    (entry,) = listing.entries
    found = number(results, entry.values[0])
    table = results.source("sure").table
    expected = {
        node: attack_calibration(select(table, variant=0, nodes=[node]), 10).error for node in ("e1", "e2")
    }
    assert (found.number, found.trials) == (expected["e1"], 6)
    assert word_on(entry.values[0], found) is Word.HOLDS
    assert word_on(Value(label="x", paper=0.9, statistic="calibration_error"), found) is Word.DIFFERS, (
        "no single trial has such a value"
    )
    _, figure, *_ = blocks_of(entry, "own", results, Counter())
    assert isinstance(figure, Figure)
    assert figure.name == "own-reliability"
    own = attack_calibration(select(table, variant=0, nodes=["e1"]), 10)
    np.testing.assert_array_equal(figure.initial.traces[1]["y"], own.frequency.value[own.count > 0])
    _, points = over_what_varies(results, entry.points[0])
    assert [point.number for point in points] == [expected["e1"], expected["e2"]]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('"attack_probability"', '"rmse.x1"', "no series of probabilities 'rmse.x1'; .*attack_probability"),
        ('node = "e1",', 'node = "e1", over = {node = "e2"},', "no single trial's value to divide"),
    ],
)
def test_what_has_no_calibration_error_is_refused(tmp_path: Path, old: str, new: str, told: str) -> None:
    assert old in LIST
    (tmp_path / "reproduce.toml").write_text(LIST.replace(old, new, 1))
    with pytest.raises(ReproduceError, match=told):
        read_listing(tmp_path, tmp_path / "out")
