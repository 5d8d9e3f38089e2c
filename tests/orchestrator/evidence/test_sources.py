from __future__ import annotations

import json

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from orchestrator.campaign.directory import read_facts
from orchestrator.errors import InputError
from orchestrator.evidence.chosen import choose
from orchestrator.evidence.rows import trial_rows
from orchestrator.evidence.sources import Source, load_source
from orchestrator.evidence.table import schema, table

FACTS = {
    "name": "many",
    "trials": 1,
    "first_trial": 0,
    "overrides": [],
    "swept": {},
    "versions": {},
    "variants": [{}],
    "topology_hashes": [""],
}


def test_a_runs_log_gives_the_rows_of_its_record_in_memory(run, logged, records):
    source = load_source(run.directory)
    assert (source.kind, source.name) == ("run", "small")
    assert source.table.equals(table(trial_rows(logged, records), schema(logged.state_groups)))
    assert source.provenance["seed"] == "7"


def test_a_log_alone_is_a_source_with_its_topology(run):
    source = load_source(run.directory / "run.mcap")
    (document,) = source.documents
    assert document["estimators"]["lone"]["method"] == "kalman"


def test_each_of_very_many_variants_has_its_own_topology(tmp_path):
    (tmp_path / "topologies").mkdir()
    for number in (0, 101, 1000):
        (tmp_path / "topologies" / f"variant-{number:03d}.yaml").write_text(f"steps: {number}\n")
    source = Source("campaign", "many", tmp_path, {"variants": [{"steps": str(i)} for i in range(1001)]})
    assert [source.document(number)["steps"] for number in (0, 101, 1000)] == [0, 101, 1000]
    with pytest.raises(InputError, match=r"variant-007.yaml is missing.*\n?.* again with another --out"):
        source.document(7)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("[]", "holds no facts"),
        ("null", "holds no facts"),
        ("{}", "lacks name, trials"),
        (json.dumps(FACTS | {"trials": "many"}), "something impossible of trials"),
        (json.dumps(FACTS | {"variants": [7]}), "something impossible of variants"),
        (json.dumps(FACTS | {"variants": [{}, {}]}), "something impossible of its variants"),
        (json.dumps(FACTS)[:20], "Unterminated"),
    ],
)
def test_facts_that_are_none_are_refused_with_the_reason(tmp_path, content, reason):
    (tmp_path / "campaign.json").write_text(content)
    pq.write_table(pa.table({"variant": [0]}), tmp_path / "results.parquet")
    with pytest.raises(InputError, match=f"is a damaged campaign .*{reason}.* with another --out"):
        load_source(tmp_path)
    with pytest.raises(InputError, match=f"is a damaged campaign .*{reason}.* with another --out"):
        read_facts(tmp_path)


def test_a_choice_of_variants_is_read_with_the_commas_of_its_values(tmp_path):
    values = ["[1.0, 2.0]", "[1.0, 3.0]"]
    variants = [{"plant.A": value, "steps": steps} for value in values for steps in ("5", "6")]
    facts = FACTS | {"variants": variants, "topology_hashes": [""] * len(variants)}
    (tmp_path / "campaign.json").write_text(json.dumps(facts))
    pq.write_table(pa.table({"variant": [0, 1, 2, 3]}), tmp_path / "results.parquet")
    for choice, numbers in (("plant.A=[1.0, 3.0]", [2, 3]), ("plant.A=[1.0, 3.0],steps=6", [3]), ("1", [1])):
        assert list(choose(f"{tmp_path}#{choice}").variants) == numbers
    with pytest.raises(InputError, match=r"has no variant .steps=7.; it has 0: plant\.A="):
        choose(f"{tmp_path}#steps=7")


def test_what_holds_no_evidence_is_refused_with_the_cure(tmp_path):
    with pytest.raises(InputError, match="give the directory of a run or a campaign"):
        load_source(tmp_path)
    with pytest.raises(InputError, match="give the directory of a run or a campaign"):
        load_source(tmp_path / "nothing.mcap")
