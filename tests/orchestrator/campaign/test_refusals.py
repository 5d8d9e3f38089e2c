"""What is no campaign, or another one, is refused with the cure, and nothing is lost."""

from __future__ import annotations

import resource
import subprocess
from typing import Any

import pytest

from orchestrator import exit_codes
from orchestrator.campaign.differences import differences
from orchestrator.campaign.directory import CampaignError
from orchestrator.errors import InputError
from orchestrator.topology.load import load_topology
from tests.orchestrator.campaign.conftest import (
    COMMAND,
    PATIENCE_S,
    Home,
    environment,
    facts_of,
    same_bytes,
    table_of,
)

GRID = "channel...failure=0.05,0.4"


@pytest.mark.parametrize(
    ("overrides", "change", "lines"),
    [
        (["channel...failure=0.05,0.3"], {}, ["--set channel...failure: 0.05,0.4 there, 0.05,0.3 here"]),
        ([], {}, ["--set channel...failure: 0.05,0.4 there, not given here"]),
        ([GRID, "steps=8"], {}, ["--set steps: not given there, 8 here"]),
        ([GRID, "name=other"], {}, ["--set name: not given there, other here"]),
        ([GRID], {"seed": 8}, ["--seed: 7 there, 8 here"]),
        ([GRID], {"first_trial": 1}, ["--first-trial: 0 there, 1 here"]),
        ([GRID], {"twins": True}, ["--twin: not given there, given here"]),
        (
            ["steps=8"],
            {"seed": 8},
            [
                "--set channel...failure: 0.05,0.4 there, not given here",
                "--set steps: not given there, 8 here",
                "--seed: 7 there, 8 here",
            ],
        ),
    ],
)
def test_another_campaign_is_refused_with_each_difference_once_and_the_cure(
    home: Home, overrides: list[str], change: dict[str, Any], lines: list[str]
) -> None:
    assert GRID == "channel...failure=0.05,0.4"
    home.sweep("out", 1, GRID)
    with pytest.raises(CampaignError) as refusal:
        home.sweep("out", 2, *overrides, **change)
    first, *found, cure = str(refusal.value).splitlines()
    assert first.startswith(f"{home.folder / 'out'} holds another campaign")
    assert [line.strip() for line in found] == lines
    assert cure.split("; ") == [
        "  to go on with it, give the command as it was there",
        "to begin another one, choose another --out",
    ]


def test_another_topology_is_refused_in_one_line(home: Home) -> None:
    home.sweep("out", 1, GRID)
    text = (home.folder / "small.yaml").read_text()
    (home.folder / "large.yaml").write_text(text.replace("name: small", "name: large"))
    with pytest.raises(CampaignError) as refusal:
        home.sweep("out", 2, GRID, file=home.folder / "large.yaml")
    _, *found, _ = str(refusal.value).splitlines()
    assert found == ["  the topology: small (small.yaml) there, large (large.yaml) here"]


def test_long_values_are_shown_where_they_begin_to_differ() -> None:
    long = ", ".join(f"{number}.25" for number in range(60))
    there, here = ({"overrides": [f"sensors...C=[[{long}, {last}]]"]} for last in ("7.0", "8.0"))
    (found,) = differences(there, here)
    assert len(found.line) < 120
    assert "7.0]]" in found.line.partition(" there, ")[0]
    assert "8.0]]" in found.line.partition(" there, ")[2]


def test_a_changed_topology_or_version_is_refused_with_what_has_changed(home: Home) -> None:
    out, _ = home.sweep("out", 1)
    text = (home.folder / "small.yaml").read_text()
    (home.folder / "small.yaml").write_text(text.replace("std: 0.1", "std: 0.2"))
    with pytest.raises(CampaignError, match=r"the topology: its file.*\n.* put the topology back as it was"):
        home.sweep("out", 2)
    (home.folder / "small.yaml").write_text(text)
    facts = (out / "campaign.json").read_text()
    numpy = facts_of(out)["versions"]["version.numpy"]
    (out / "campaign.json").write_text(facts.replace(f'"{numpy}"', '"0.9"'))
    with pytest.raises(CampaignError, match=r"numpy: 0\.9 there, .*\n.* use the versions that are there"):
        home.sweep("out", 2)


@pytest.mark.parametrize("content", ["[]", "{}", "null", '{"name": "small"}', "{"])
def test_damaged_facts_are_told_by_every_command_with_the_cure(home: Home, content: str) -> None:
    out, _ = home.sweep("out", 1)
    (out / "campaign.json").write_text(content)
    replay = ("replay", "out", "--trial", "0")
    for arguments in (("sweep", "small.yaml", "--trials", "1", "--out", "out"), replay, ("compare", "out")):
        done = home.command(*arguments)
        assert done.returncode == exit_codes.BAD_INPUT
        assert done.stderr.startswith("gauntlet: out is a damaged campaign (")
        assert "give its 'gauntlet sweep' again with another --out" in done.stderr


@pytest.mark.parametrize(
    ("first", "trials", "told"),
    [
        (2**31 - 2, 3, "the last trial would be 2147483648, and the largest is 2147483647"),
        (2**40, 1, "largest"),
    ],
)
def test_trials_beyond_what_results_can_hold_are_refused(
    home: Home, first: int, trials: int, told: str
) -> None:
    with pytest.raises(InputError, match=told):
        home.sweep("out", trials, first_trial=first)
    assert not (home.folder / "out").exists()


def test_the_largest_trial_has_its_row(home: Home) -> None:
    out, _ = home.sweep("out", 1, first_trial=2**31 - 1)
    assert set(table_of(out)["trial"].to_pylist()) == {2**31 - 1}
    with pytest.raises(InputError, match="must be at most 2147483647"):
        load_topology(home.folder / "small.yaml", trial=2**31)


def test_damaged_results_are_told_with_a_cure_that_works(home: Home) -> None:
    out, _ = home.sweep("out", 2)
    results = out / "results.parquet"
    whole = results.read_bytes()
    results.write_bytes(whole[:500])
    with pytest.raises(InputError, match=r"results.parquet is damaged; remove it"):
        home.sweep("out", 2)
    results.unlink()
    home.sweep("out", 2)
    assert results.read_bytes() == whole


def test_a_directory_with_something_else_is_refused(home: Home) -> None:
    (home.folder / "full").mkdir()
    (home.folder / "full" / "thesis.tex").write_text("")
    with pytest.raises(CampaignError, match="holds something else"):
        home.sweep("full", 1)


def test_a_path_that_is_no_directory_is_refused(home: Home) -> None:
    (home.folder / "file").write_text("")
    with pytest.raises(CampaignError, match="file cannot be used"):
        home.sweep("file", 1)


def test_a_full_disk_is_told_and_the_campaign_goes_on_later(home: Home) -> None:
    arguments = ["sweep", "small.yaml", "--trials", "2", "-j", "1", "--out", "out"]
    room = 8192
    done = subprocess.run(
        [*COMMAND, *arguments],
        cwd=home.folder,
        env=environment(),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 3, done.stderr
    assert "arrows cannot be written" in done.stderr
    whole, _ = home.sweep("whole", 2)
    later, _ = home.sweep("out", 2)
    assert same_bytes(whole, later)
