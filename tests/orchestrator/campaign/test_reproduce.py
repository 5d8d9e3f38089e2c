"""The campaigns of a folder by one command; those of the papers' folders are all in order."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from orchestrator.report.contents import Figure
from orchestrator.reproduction.blocks import blocks_of
from orchestrator.reproduction.errors import ReproduceError
from orchestrator.reproduction.listing import read_listing
from orchestrator.reproduction.measuring import Results, number, over_what_varies, series
from orchestrator.reproduction.one_trial import run_again
from orchestrator.reproduction.page import paper_page
from orchestrator.reproduction.reports import write_index
from tests.orchestrator.campaign.conftest import ROOT, SMALL, Home, table_of

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


FIGURES = """
paper = "Somebody 2020"

[plain]
file = "small.yaml"
trials = 6

[lossy]
file = "small.yaml"
trials = 6
set = ["channel...failure=0.4,0.05"]

[[figure]]
name = "Table 1"
about = "errors"
campaign = "plain"
metric = "rmse.position"
values = [
  {label = "one node", node = "e1", paper = 0.05},
  {label = "over itself", node = "e1", over = {node = "e1"}, paper = "same", at_most = 1, at_least = 1},
  {label = "runs with a large error", node = "e1..e3", statistic = "share", above = 1e6},
]

[[figure]]
name = "Fig 2"
about = "one run, and errors over time"
campaign = "plain"
metric = "error.position"
curves = [{label = "attacked", node = "e2"}]
run = {trial = 4}

[[figure]]
name = "Fig 3"
about = "over losses"
campaign = "lossy"
metric = "rmse.position"
points = [{label = "all", setting = "channel...failure"}]

[[figure]]
name = "Fig 1"
about = "a drawing"
missing = "it shows no results"
"""


def test_every_campaign_of_the_list_is_run_into_a_directory_of_its_name(home: Home) -> None:
    (home.folder / "reproduce.toml").write_text(LIST)
    done = home.command("reproduce", ".", "--out", "all", "-j", "2", "--no-reports", "--json")
    assert done.returncode == 0, done.stderr
    assert not (home.folder / "all" / "index.html").exists()
    assert list(json.loads(done.stdout)["campaigns"]) == ["plain", "lossy"]
    assert table_of(home.folder / "all" / "plain").num_rows == 3 * 3
    lossy = table_of(home.folder / "all" / "lossy")
    assert (lossy.num_rows, set(lossy["seed"].to_pylist())) == (2 * 2 * 3, {9})


def test_a_first_look_takes_fewer_trials_and_only_what_is_named(home: Home) -> None:
    (home.folder / "reproduce.toml").write_text(LIST)
    (own,) = read_listing(home.folder, only=["plain"], trials=1).campaigns
    assert (own.name, own.about, own.campaign.request.trials) == ("plain", "as it stands", 1)
    with pytest.raises(ReproduceError, match="did you mean 'plain'"):
        read_listing(home.folder, only=["plane"])


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
        read_listing(home.folder)


def test_a_folder_without_a_list_is_refused(home: Home) -> None:
    with pytest.raises(ReproduceError, match=r"reproduce\.toml cannot be read"):
        read_listing(home.folder)


@pytest.mark.parametrize(
    "paper", sorted(file.parent.name for file in ROOT.glob("topologies/*/reproduce.toml"))
)
def test_the_campaigns_of_the_papers_are_in_order(paper: str, tmp_path: Path) -> None:
    listed = read_listing(ROOT / "topologies" / paper, tmp_path / "none").campaigns
    assert len(listed) >= 2
    assert all(own.about for own in listed)
    assert not (tmp_path / "none").exists()


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A folder whose figures are made, and what the command told."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "small.yaml").write_text(SMALL)
    (folder / "reproduce.toml").write_text(FIGURES)
    done = Home(folder).command("reproduce", ".", "--out", "all", "-j", "2", "--json")
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def test_all_figures_of_a_list_are_written_and_stay_as_they_are_when_it_goes_on(
    finished: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, told = finished
    monkeypatch.chdir(folder)
    names = [str(Path(path).relative_to("all")) for path in told["reports"]]
    assert names == ["plain/report.html", "lossy/report.html", "plain/variant-0-trial-4.html"]
    assert all((folder / "all" / name).stat().st_size > 10_000 for name in names)
    index = folder / "all" / "index.html"
    text = index.read_text()
    for expected in ("Somebody 2020", "Table 1", "over itself", "1 [1, 1]", "it shows no results", "holds"):
        assert expected in text
    for target in ("plain/report.html", "plain/variant-0-trial-4.html"):
        assert f'href="{target}"' in text
    listing = read_listing(Path("."), Path("all"))
    run = listing.entries[1].run
    assert run is not None
    log = folder / "all" / "plain" / "replays" / "variant-0-trial-4" / "run.mcap"
    before = log.stat().st_mtime_ns
    assert run_again(Path("all/plain"), run) == log.relative_to(folder)
    write_index(listing)
    assert (index.read_text(), log.stat().st_mtime_ns) == (text, before)


def test_numbers_on_the_page_are_those_of_the_results(finished: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = finished
    home = Home(folder)
    results = Results({name: home.folder / "all" / name for name in ("plain", "lossy")})
    listing = read_listing(home.folder, home.folder / "all")
    table, curves, swept, _ = listing.entries
    rows = [row for row in table_of(home.folder / "all" / "plain").to_pylist() if row["node"] == "e1"]
    found = number(results, table.values[0])
    assert found.number.value == np.median([row["rmse.position"] for row in rows])
    x, points = over_what_varies(results, swept.points[0])
    assert x.tolist() == [0.05, 0.4]
    of_first = [
        row["rmse.position"]
        for row in table_of(home.folder / "all" / "lossy").to_pylist()
        if row["set.channel...failure"] == "0.05"
    ]
    by_trial = np.sqrt(np.mean(np.square(np.reshape(of_first, (6, 3))), axis=1))
    assert points[0].number.value == pytest.approx(np.median(by_trial))
    errors = [
        row["error.position"]
        for row in table_of(home.folder / "all" / "plain").to_pylist()
        if row["node"] == "e2"
    ]
    expected = np.sqrt(np.mean(np.square(errors), axis=0))
    np.testing.assert_allclose(series(results, curves.curves[0]).value, expected)


def test_a_logarithmic_axis_holds_the_intervals_and_not_only_the_points(
    finished: tuple[Path, dict[str, Any]],
) -> None:
    folder, _ = finished
    plain = read_listing(folder, folder / "all").entries[2]
    entry = replace(plain, log_y=True, points=[replace(plain.points[0], statistic="rms")])
    results = Results({"lossy": folder / "all" / "lossy"})
    figure = next(block for block in blocks_of(entry, "fig", results, Counter()) if isinstance(block, Figure))
    low, high = 10.0 ** np.array(figure.layout["yaxis"]["range"])
    (trace,) = figure.initial.traces
    assert np.all(trace["error_y"]["array"] > 0.0)
    assert low < np.min(trace["y"] - trace["error_y"]["arrayminus"])
    assert np.max(trace["y"] + trace["error_y"]["array"]) < high


def test_the_page_speaks_of_the_paper_only_where_something_is_set_beside_it(
    finished: tuple[Path, dict[str, Any]],
) -> None:
    folder, _ = finished
    listing = read_listing(folder, folder / "all")
    assert "Of what the paper says" in paper_page(listing).headline
    alone = paper_page(dataclasses.replace(listing, entries=listing.entries[1:]))
    assert alone.headline == "2 figures, tables and claims regenerated."
    assert [tile.name for tile in alone.tiles] == ["Campaigns", "Trials", "Figures and tables"]
    assert "paper" not in alone.facts


def test_a_page_of_few_trials_says_at_its_head_what_that_leaves_open(
    finished: tuple[Path, dict[str, Any]],
) -> None:
    folder, _ = finished
    listing = read_listing(folder, folder / "all")
    page = paper_page(listing)
    assert page.tone == "warn"
    assert page.warnings == [
        "Few trials: a campaign has 6. Below 6 there are no intervals and no verdicts, below 10 no "
        "range of single runs, and below 20 bands of curves are too narrow. Ask for 20 or more."
    ]
    verdicts = {row[0]: row[3].text for row in page.sections[1].blocks[0].rows}
    assert verdicts["one node"] == "open: fewer than 10 trials"
    assert verdicts["over itself"] == "holds"


def test_a_curve_of_too_few_trials_has_no_band(home: Home) -> None:
    (home.folder / "reproduce.toml").write_text(FIGURES)
    done = home.command("reproduce", ".", "--trials", "3", "--out", "all", "--no-reports")
    assert done.returncode == 0, done.stderr
    curve = read_listing(home.folder).entries[1].curves[0]
    found = series(Results({"plain": home.folder / "all" / "plain"}), curve)
    assert np.isfinite(found.value).all()
    assert np.isnan([found.low, found.high]).all()


def test_what_only_leaves_out_is_said_instead_of_shown(home: Home) -> None:
    (home.folder / "reproduce.toml").write_text(FIGURES)
    done = home.command("reproduce", ".", "--only", "plain", "--trials", "2", "--out", "all")
    assert done.returncode == 0, done.stderr
    assert "needs lossy, left out by --only" in (home.folder / "all" / "index.html").read_text()
    assert done.stdout.rstrip().endswith("all of it: all/index.html")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('node = "e2"', 'node = "e9"', "'plain' has no estimator 'e9'"),
        ('metric = "error.position"', 'metric = "error.positon"', "did you mean 'error.position'"),
        ('"channel...failure"}', '"channel...failures"}', "does not vary 'channel...failures'"),
        ('campaign = "lossy"', 'campaign = "losy"', "did you mean 'lossy'"),
        (
            'statistic = "share"',
            'statistic = "shares"',
            "[[figure]] 'Table 1': Invalid enum value 'shares' - at `values[2].statistic`",
        ),
        ('name = "Fig 3"', 'name = "Fig 2"', "two [[figure]] are called 'Fig 2'"),
        ('missing = "it shows no results"', "", "shows nothing"),
    ],
)
def test_a_figure_that_cannot_be_made_is_refused_before_any_trial(
    home: Home, old: str, new: str, told: str
) -> None:
    assert old in FIGURES
    (home.folder / "reproduce.toml").write_text(FIGURES.replace(old, new, 1))
    done = home.command("reproduce", ".", "--out", "all")
    assert done.returncode == 2
    assert told in " ".join(done.stderr.split())
    assert not (home.folder / "all").exists()
