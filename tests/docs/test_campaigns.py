"""The columns that docs/campaigns.md tells are those that results have."""

from __future__ import annotations

import re
from pathlib import Path

from orchestrator.evidence.rows import scalar_names
from orchestrator.evidence.table import columns

PAGE = (Path(__file__).parents[2] / "docs" / "campaigns.md").read_text()
GROUPS = ["position"]


def told() -> set[str]:
    """The names in the first column of the table, with ``.link`` and GROUP written out."""
    table = PAGE.partition("| columns | meaning |")[2].partition("\n\n")[0]
    found: set[str] = set()
    for line in table.splitlines()[2:]:
        before = ""
        for name in re.findall(r"`([^`]+)`", line.split("|")[1]):
            whole = before.rpartition(".")[0] + name if name.startswith(".") else name
            found |= {whole.replace("GROUP", group) for group in (*GROUPS, "state")}
            before = whole
    return found


def test_every_column_of_results_is_told_and_none_that_there_is_not() -> None:
    there = set(columns(GROUPS, ["PATH"]))
    assert told() - there == set()
    assert there - told() - set(scalar_names(GROUPS)) == set()  # of the metrics, the score's page tells
