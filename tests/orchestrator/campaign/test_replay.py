"""One trial of a campaign alone, with its log: the same score, and told so."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from orchestrator import exit_codes
from orchestrator.evidence.sources import SourceError
from orchestrator.handoff import load
from tests.orchestrator.campaign.conftest import Home, table_of

GRID = "channel...failure=0.05,0.4"


def test_a_replayed_trial_has_its_log_and_the_score_of_its_row(home: Home) -> None:
    out, _ = home.sweep("out", 4, GRID, workers=2)
    done = home.command("replay", "out", "--variant", "1", "--trial", "3", "--backend", "processes")
    assert "the score is that of the campaign's row, bit for bit" in done.stderr
    (run,) = (out / "replays").iterdir()
    assert (run / "run.mcap").exists()
    rows = table_of(out)
    row = rows.filter(pc.and_(pc.equal(rows["variant"], 1), pc.equal(rows["trial"], 3)))
    passed = row["passed"][0].as_py()
    assert done.returncode == (0 if passed else 1)


def test_the_command_that_a_campaign_ends_with_replays_a_trial_whatever_its_folder_is_called(
    home: Home,
) -> None:
    done = home.command("sweep", "small.yaml", "--trials", "1", "--out", "the first's out")
    (told,) = re.findall(r"one trial with its log: gauntlet (.*)", done.stdout)
    again = home.command(*shlex.split(told))
    assert "the score is that of the campaign's row, bit for bit" in again.stderr
    with pytest.raises(SourceError) as refused:
        _ = load(home.folder / "the first's out").estimates
    (advised,) = re.findall(r"`gauntlet (.*)`", str(refused.value))
    assert shlex.split(advised) == ["replay", str(home.folder / "the first's out"), "--trial", "0"]


def test_a_score_that_is_not_that_of_the_row_is_told(home: Home) -> None:
    out, _ = home.sweep("out", 1)
    _with_another_rmse(out / "results.parquet")
    done = home.command("replay", "out", "--trial", "0", "--backend", "inprocess", "--out", "run")
    assert "NOT that of the campaign (rmse.position): are the versions" in done.stderr
    assert done.returncode == exit_codes.EXPECTATION_FAILED
    told = home.command("replay", "out", "--trial", "0", "--backend", "inprocess", "--json").stdout
    assert json.loads(told)["campaign"]["same_score"] is False


def _with_another_rmse(results: Path) -> None:
    rows = pq.read_table(results)
    place = rows.column_names.index("rmse.position")
    pq.write_table(rows.set_column(place, "rmse.position", pa.array([0.5] * rows.num_rows)), results)


def test_what_is_not_there_cannot_be_replayed(home: Home) -> None:
    home.sweep("out", 1)
    done = home.command("replay", "out", "--variant", "3", "--trial", "0")
    assert (done.returncode, "its variants are 0 to 0" in done.stderr) == (2, True)
    done = home.command("replay", "nowhere", "--trial", "0")
    assert (done.returncode, "holds no campaign" in done.stderr) == (2, True)
