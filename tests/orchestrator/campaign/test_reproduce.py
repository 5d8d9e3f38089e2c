"""The campaigns of a folder by one command; those of the papers' folders are all in order."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from orchestrator.campaign.reproduce import ReproduceError, listed_campaigns
from tests.orchestrator.campaign.conftest import ROOT, Home, table_of

LIST = """
[plain]
file = "small.yaml"
trials = 3
about = "as it stands"

[lossy]
file = "small.yaml"
trials = 2
seed = 9
set = ["channel...failure=0.05,0.4"]
"""


def test_every_campaign_of_the_list_is_run_into_a_directory_of_its_name(home: Home) -> None:
    (home.folder / "reproduce.toml").write_text(LIST)
    done = home.command("reproduce", ".", "--out", "all", "-j", "2", "--json")
    assert done.returncode == 0, done.stderr
    assert list(json.loads(done.stdout)["campaigns"]) == ["plain", "lossy"]
    assert table_of(home.folder / "all" / "plain").num_rows == 3 * 3
    lossy = table_of(home.folder / "all" / "lossy")
    assert (lossy.num_rows, set(lossy["seed"].to_pylist())) == (2 * 2 * 3, {9})


def test_a_first_look_takes_fewer_trials_and_only_what_is_named(home: Home) -> None:
    (home.folder / "reproduce.toml").write_text(LIST)
    (own,) = listed_campaigns(home.folder, only=["plain"], trials=1)
    assert (own.name, own.about, own.campaign.request.trials) == ("plain", "as it stands", 1)
    with pytest.raises(ReproduceError, match="did you mean 'plain'"):
        listed_campaigns(home.folder, only=["plane"])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x = 3", "x is no campaign"),
        ("[x]\nfile = 'small.yaml'", "does not say its trials"),
        ("[x]\nfile = 'small.yaml'\ntrials = 1\nsets = []", "no key 'sets'; did you mean 'set'"),
        ("[x]\nfile = 'small.yaml'\ntrials = '1'", "trials is no int"),
        ("[x]\nfile = 'small.yaml'\ntrials = 0", "at least one trial"),
        ("[x", "is not TOML"),
    ],
)
def test_a_list_that_makes_no_sense_is_refused_with_its_place(home: Home, text: str, told: str) -> None:
    (home.folder / "reproduce.toml").write_text(text)
    with pytest.raises(ReproduceError, match=told):
        listed_campaigns(home.folder)


def test_a_folder_without_a_list_is_refused(home: Home) -> None:
    with pytest.raises(ReproduceError, match=r"reproduce\.toml cannot be read"):
        listed_campaigns(home.folder)


@pytest.mark.parametrize(
    "paper", sorted(file.parent.name for file in ROOT.glob("topologies/*/reproduce.toml"))
)
def test_the_campaigns_of_the_papers_are_in_order(paper: str, tmp_path: Path) -> None:
    listed = listed_campaigns(ROOT / "topologies" / paper, tmp_path / "none")
    assert len(listed) >= 5
    assert all(own.about for own in listed)
    assert not (tmp_path / "none").exists()
