from __future__ import annotations

import pytest

from orchestrator.errors import InputError
from orchestrator.evidence.rows import trial_rows
from orchestrator.evidence.sources import load_source
from orchestrator.evidence.table import schema, table


def test_a_runs_log_gives_the_rows_of_its_record_in_memory(run, logged, records):
    source = load_source(run.directory)
    assert (source.kind, source.name) == ("run", "small")
    assert source.table.equals(table(trial_rows(logged, records), schema(logged.state_groups)))
    assert source.provenance["seed"] == "7"


def test_a_log_alone_is_a_source_with_its_topology(run):
    source = load_source(run.directory / "run.mcap")
    (document,) = source.documents
    assert document["estimators"]["lone"]["method"] == "kalman"


def test_what_holds_no_evidence_is_refused_with_the_cure(tmp_path):
    with pytest.raises(InputError, match="give the directory of a run or a campaign"):
        load_source(tmp_path)
    with pytest.raises(InputError, match="give the directory of a run or a campaign"):
        load_source(tmp_path / "nothing.mcap")
