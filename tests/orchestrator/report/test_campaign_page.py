"""The page of many trials: groups, figures, comparison, and what it says of trials that failed."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from orchestrator.campaign.sweep import Request, prepare, sweep
from orchestrator.command_line.campaign_output import QuietProgress
from orchestrator.evidence.chosen import Chosen, choose
from orchestrator.evidence.figures import rmse
from orchestrator.evidence.sources import Source, load_source
from orchestrator.report.contents import Page, Table, Text
from orchestrator.report.errors import ReportError
from orchestrator.report.grouping import find_groups
from orchestrator.report.groups import Outcomes, short_names, trial_rmse
from orchestrator.report.making import page_for
from orchestrator.report.page import write_page
from tests.orchestrator.report.conftest import SWEPT
from tests.orchestrator.report.looking import look_at

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytest.importorskip("plotly", reason="reports are an extra")
pytest.importorskip("jinja2", reason="reports are an extra")
pytest.importorskip("pyarrow", reason="campaigns are an extra")


ATTACKS = ("as given", "null")

OTHER = """
name: other
steps: 20
period_s: 0.1
plant: {model: linear, A: [[0.9]], process_noise: {std: 0.1}, initial: {std: 1.0}}
sensors: {s1: {model: linear, C: [[1.0]], noise: {std: 0.1}}}
estimators: {e1: {method: kalman, sensors: [s1]}}
"""


def table(page: Page, title: str) -> Table:
    """Return the table of a page whose caption begins so."""
    blocks = [block for section in page.sections for block in section.blocks]
    return next(own for own in blocks if isinstance(own, Table) and own.caption.startswith(title))


def test_groups_are_estimators_that_differ_only_in_what_they_hear(campaign: Path) -> None:
    groups = find_groups([choose(campaign)], None, [])
    assert len({group.variant for group in groups}) == 2
    assert [group.nodes for group in groups[:3]] == [["e1", "e2", "e3"], ["lone"], ["strict"]]
    assert groups[0].attacked == ("e2",)
    assert len({group.name for group in groups}) == len(groups)


@pytest.mark.parametrize(("by", "each"), [("node", 5), ("method", 2), ("variant", 1)])
def test_groups_can_be_made_otherwise(campaign: Path, by: str, each: int) -> None:
    groups = find_groups([choose(campaign)], by, [])
    assert len(groups) == 2 * each


def test_a_variant_of_a_campaign_is_reported_alone_with_the_figures_it_has_among_all(
    campaign: Path, campaign_page: Page
) -> None:
    alone = page_for([f"{campaign}#attacks=null"])
    assert table(alone, "Variants").rows[0][1] == "attacks null, secure_distributed"
    whole = table(campaign_page, "RMSE over all").rows
    assert table(alone, "RMSE over all").rows == [row for row in whole if row[0].startswith("attacks null")]
    assert alone.facts.endswith("Of the 2 variants of swept, those with attacks=null.")
    assert table(alone, "Consistency over all").rows
    by_number = page_for([f"{campaign}#1"])
    assert table(by_number, "RMSE over all").rows == table(alone, "RMSE over all").rows
    assert by_number.facts.endswith("Of the 2 variants of swept, number 1: attacks=null.")


def test_variants_of_two_places_are_told_apart_by_these(campaign: Path, attacked_run: Path) -> None:
    names = [
        row[1] for row in table(page_for([f"{campaign}#0", f"{campaign}#1"], "variant"), "Variants").rows
    ]
    assert names == ["attacks as given", "attacks null"], "one campaign needs no name"
    names = [row[1] for row in table(page_for([f"{campaign}#1", attacked_run], "variant"), "Variants").rows]
    assert names == ["swept, attacks null", "attacked-run"]


@pytest.fixture(scope="module")
def lossy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a campaign over a loss and a threshold."""
    home = tmp_path_factory.mktemp("lossy")
    (home / "lossy.yaml").write_text(SWEPT + "channel: {s1->lone: {bernoulli: {loss: 0.1}}}\n")
    grid = ("channel...loss=0.5,0.0,0.2", "estimators.strict.threshold=4,9")
    request = Request(home / "lossy.yaml", 2, overrides=grid, out=home / "out")
    return sweep(prepare(request), QuietProgress())


def test_errors_are_drawn_over_the_numbers_that_were_swept(lossy: Path) -> None:
    page = page_for([lossy])
    (figure,) = (own for own in page.figures if own.name == "swept")
    assert figure.title == "RMSE over loss"
    (path, *_), *_ = figure.views
    assert {key[0] for key in figure.views} == {"channel...loss"}, "two thresholds make no curve"
    lines = {trace["name"]: trace for trace in figure.views[path, "position", "all"].traces}
    assert len(lines) == 2 * 3, "two thresholds, three kinds of estimators"
    drawn = lines["threshold 9, kalman lone"]
    assert drawn["x"].tolist() == [0.0, 0.2, 0.5]
    groups = find_groups([choose(lossy)], None, [])
    own = {group.settings[path]: group for group in groups if group.nodes == ["lone"]}
    found = [rmse(own[value].rows, "position").value for value in ("0.0", "0.2", "0.5")]
    assert drawn["y"] == pytest.approx(found)


def test_by_a_path_all_estimators_of_a_value_are_one_as_in_a_comparison(lossy: Path) -> None:
    page = page_for([f"{lossy}#channel...loss=0.2"], "estimators.strict.threshold")
    assert [row[1:4:2] for row in table(page, "Variants").rows] == [
        ("loss 0.2, threshold 4", "2"),
        ("loss 0.2, threshold 9", "2"),
    ]
    (figure,) = (own for own in page.figures if own.name == "swept")
    (trace,) = figure.initial.traces
    assert trace["x"].tolist() == [4.0, 9.0]


def test_settings_are_named_by_as_much_as_tells_them_apart() -> None:
    assert short_names(["a.b.value", "c.rate"]) == {"a.b.value": "value", "c.rate": "rate"}
    assert short_names(["a.b.value", "c.value"]) == {"a.b.value": "b.value", "c.value": "c.value"}


def test_the_page_says_what_the_statistics_of_evidence_say(campaign: Path, campaign_page: Page) -> None:
    groups = find_groups([choose(campaign)], None, [])
    own = table(campaign_page, "RMSE over all")
    found = rmse(groups[1].rows, "position")
    column = list(own.columns).index("position")
    assert own.rows[1][0] == groups[1].name
    assert own.rows[1][column] == f"{found.value:.4g} [{found.low:.3g}, {found.high:.3g}]"


def test_the_page_marks_whom_an_oracle_tells_of_attacks(tmp_path: Path) -> None:
    file = Path(__file__).parents[3] / "topologies/sadeghzadeh2022/noisy_sensor.yaml"
    request = Request(file, 2, overrides=("steps=30",), out=tmp_path / "out", workers=1)
    groups = find_groups([choose(sweep(prepare(request), QuietProgress()))], "node", [])
    assert [group.name for group in groups] == [
        *("clean", "normal", "proposed PRIVILEGED", "rederived PRIVILEGED", "tracking")
    ]


def test_the_error_of_a_trial_is_that_of_its_estimators_together(campaign: Path) -> None:
    group = find_groups([choose(campaign)], None, [])[0]
    values = group.rows.scalar("rmse.position").reshape(3, 3)
    assert trial_rmse(group.rows, "position") == pytest.approx(np.sqrt(np.mean(values**2, axis=1)))
    assert trial_rmse(group.of("attacked"), "position") == pytest.approx(values[:, 1])


def test_an_attack_has_its_price_beside_its_unattacked_twin(campaign_page: Page) -> None:
    own = table(campaign_page, "Price of the attack in rmse.position")
    assert len(own.rows) == 3
    assert own.rows[1][3].startswith("0 [")  # nobody attacked `lone`


def test_trials_without_a_score_are_counted_and_told(campaign: Path, tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    from orchestrator.evidence.rows import FAILED

    source = load_source(campaign)
    for file in campaign.iterdir():
        if file.is_file() and file.name != "results.parquet":
            (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "topologies").mkdir()
    for file in (campaign / "topologies").iterdir():
        (tmp_path / "topologies" / file.name).write_bytes(file.read_bytes())
    rows = source.table.to_pylist()
    keys = {"variant": 0, "trial": 1}
    broken = [row for row in rows if any(row[key] != value for key, value in keys.items())]
    lost = next(row for row in rows if all(row[key] == value for key, value in keys.items()))
    empty = dict.fromkeys(lost) | {key: lost[key] for key in ("variant", "trial", "seed")}
    failed = {**empty, "node": "", "method": "", "status": FAILED, "message": "it broke", "passed": False}
    held = type(source.table).from_pylist([*broken, failed], schema=source.table.schema)
    pq.write_table(
        held.sort_by([("variant", "ascending"), ("trial", "ascending")]), tmp_path / "results.parquet"
    )
    groups = find_groups([choose(tmp_path)], None, [])
    assert Outcomes.of(groups) == dataclasses.replace(
        Outcomes.of(find_groups([choose(campaign)], None, [])), failed=1, passed=5
    )
    page = page_for([tmp_path])
    assert page.word == "PARTLY FAILED"
    assert table(page, "Trials without a score (1)").rows[0][-1] == "it broke"


def test_two_runs_are_compared_on_one_page(attacked_run: Path) -> None:
    page = page_for([attacked_run, attacked_run])
    assert page.kind == "Comparison"
    names = [group[1] for group in table(page, "Variants").rows]
    assert len(set(names)) == 4, "two methods of each run, told apart"
    verdicts = {(row[1], row[2]): row[-1].text for row in table(page, "Every two").rows}
    assert verdicts[names[0], names[2]] == "identical"
    assert page.warnings == []
    assert {row[-2] for row in table(page, "Every two").rows} == {"1 common"}


def test_trials_of_other_seeds_are_compared_unpaired_and_the_page_says_so(
    campaign: Path, tmp_path: Path
) -> None:
    request = Request(campaign.parent / "swept.yaml", 2, seed=9, out=tmp_path / "other")
    other = sweep(prepare(request), QuietProgress())
    page = page_for([f"{campaign}#attacks=as given", other], "variant")
    assert page.warnings == []
    rows = [row for row in table(page, "Every two").rows if row[0] == "rmse.position"]
    assert [row[-2] for row in rows] == ["3, 2 unpaired"]
    assert [tile.remark for tile in page.tiles if tile.name == "Trials"] == [""], "not as many of each"


def test_every_difference_has_a_row_of_its_own_however_long_the_names(campaign_page: Page) -> None:
    figure = next(own for own in campaign_page.figures if own.name == "differences")
    for view in figure.views.values():
        assert view.traces[0]["y"].tolist() == view.layout["yaxis"]["tickvals"]
        assert len(set(view.layout["yaxis"]["ticktext"])) == view.traces[0]["y"].size


def test_names_too_long_for_an_axis_are_numbers_there_and_never_cut(campaign: Path) -> None:
    def labels(by: str) -> list[str]:
        page = page_for([campaign], by)
        (figure,) = (own for own in page.figures if own.name == "differences")
        text: list[str] = figure.initial.layout["yaxis"]["ticktext"]
        return text

    assert labels("variant") == ["1 attacks as given<br>less 2 attacks null"]
    assert labels("method")[0] == "1 less 2", (
        "attacks as given, secure_distributed less attacks as given, kalman"
    )


def test_sources_of_different_plants_are_compared_in_what_they_share(
    attacked_run: Path, tmp_path: Path
) -> None:
    from orchestrator.run import run_topology
    from orchestrator.run_directory import make_run_directory
    from orchestrator.topology.load import load_topology

    (tmp_path / "other.yaml").write_text(OTHER)
    topology = load_topology(tmp_path / "other.yaml")
    directory = make_run_directory(tmp_path / "out", "other", 1)
    run_topology(topology, directory, "inprocess", lambda recorded: None)
    page = page_for([attacked_run, directory])
    assert table(page, "RMSE over all").columns == ("variant", "whole state")
    assert page.warnings == [
        "They ran different plants (plant.model is constant_acceleration for attacked-run, linear for other)"
        ": a difference in errors may be the plants', not the estimators'.",
        "Their runs are not as long (steps is 60 for attacked-run, 20 for other): "
        "averages, peaks and counts are not of the same time.",
    ]
    assert page.tone == "warn"
    assert "smallest RMSE" not in page.headline, "what is of different plants has no best one"
    write_page(page, tmp_path / "report.html")
    assert "<strong>Warning</strong> They ran different plants" in (tmp_path / "report.html").read_text()


def test_a_run_taken_apart_by_node_compares_its_estimators(attacked_run: Path) -> None:
    page = page_for([attacked_run], "node")
    assert "Comparison" in [section.title for section in page.sections]
    assert page.headline.startswith("All that was expected held in 0 of 1 trials")


def test_the_same_campaign_gives_the_same_bytes(campaign: Path, campaign_file: Path, tmp_path: Path) -> None:
    write_page(page_for([campaign]), tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == campaign_file.read_bytes()


def test_very_many_judged_packets_are_read_in_part_and_the_page_says_so(
    campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("orchestrator.report.grouping.PACKETS", 100)
    notes: list[str] = []
    groups = find_groups([choose(campaign)], None, notes)
    assert notes[0].startswith("Detection is told of the first 2 of 3 trials")
    assert groups[0].judged.trials == 2
    assert groups[0].rows.trials == 3


def test_only_estimators_that_exchange_are_called_a_network(campaign: Path, campaign_page: Page) -> None:
    groups = {group.name: group for group in find_groups([choose(campaign)], None, [])}
    assert {own.nodes[0] for own in groups.values() if own.is_apart} == {"lone", "strict"}
    (figure,) = (own for own in campaign_page.figures if own.name == "disagreement")
    named = {trace["name"] for trace in figure.initial.traces}
    assert named == {
        *(name for name, own in groups.items() if not own.is_apart),
        *(f"attacks {text}, kalman lone and attacks {text}, kalman strict, each alone" for text in ATTACKS),
    }


def test_every_figure_of_a_campaign_is_one_that_plotly_takes(campaign_page: Page) -> None:
    from plotly.graph_objects import Figure as Checked

    from orchestrator.report.palette import LIGHT
    from orchestrator.report.payload import plotly_figure

    figures = campaign_page.figures
    assert [figure.name for figure in figures] == [
        *("outcomes", "differences", "rmse", "trials", "consistency", "roc", "survival", "operating"),
        "disagreement",
    ]
    for figure in figures:
        for view in figure.views.values():
            Checked(plotly_figure(figure, view, LIGHT))


def test_communication_is_drawn_against_error_only_where_some_speak_less(
    campaign_page: Page, tmp_path: Path
) -> None:
    from plotly.graph_objects import Figure as Checked

    from orchestrator.report.palette import LIGHT
    from orchestrator.report.payload import plotly_figure

    communication = next(own for own in campaign_page.sections if own.title == "Communication")
    assert isinstance(communication.blocks[0], Text)
    assert communication.blocks[0].text.startswith("All fill their slots as often")
    (tmp_path / "quiet.yaml").write_text(SWEPT)
    grid = ("sensors.s1.send={periodic: {every: 1}},{periodic: {every: 3}}",)
    request = Request(tmp_path / "quiet.yaml", 2, overrides=grid, out=tmp_path / "out")
    page = page_for([sweep(prepare(request), QuietProgress())])
    (figure,) = (own for own in page.figures if own.name == "pareto")
    for view in figure.views.values():
        Checked(plotly_figure(figure, view, LIGHT))


def test_the_headline_names_nobody_the_best_whom_no_verdict_does(
    campaign: Path, campaign_page: Page, tmp_path: Path
) -> None:
    assert campaign_page.headline.endswith("; it is not shown to be the best.")
    request = Request(
        campaign.parent / "swept.yaml",
        8,
        overrides=("sensors.*.noise.std=0.1,2.0", "steps=20"),
        out=tmp_path / "out",
    )
    page = page_for([sweep(prepare(request), QuietProgress())], "variant")
    assert "is that of std 0.1: " in page.headline
    assert page.headline.endswith("; it is shown to be better than every other.")


def test_a_difference_has_an_interval_only_from_enough_trials_and_zero_is_always_in_sight(
    campaign_page: Page,
) -> None:
    shown = [row[3] for row in table(campaign_page, "Every two").rows]
    assert not any("infinite" in own for own in shown)
    assert any(re.fullmatch(r"-?\d[\d.]*", own) for own in shown), "three trials give none"
    (figure,) = (own for own in campaign_page.figures if own.name == "differences")
    for view in figure.views.values():
        low, high = view.layout["xaxis"]["range"]
        assert low < 0.0 < high
        assert low < view.traces[0]["x"].min() <= view.traces[0]["x"].max() < high


def test_no_group_is_missing_from_what_is_shown_first(campaign: Path, attacked_run: Path) -> None:
    mixed = page_for([campaign], "variant")
    own = next(figure for figure in mixed.figures if figure.name == "rmse")
    named = {trace["name"] for trace in own.initial.traces if "fill" not in trace}
    assert {"attacks as given", "attacks null"} <= named, "only one of them was attacked"
    attacked = page_for([f"{campaign}#attacks=as given", attacked_run], "variant")
    own = next(figure for figure in attacked.figures if figure.name == "rmse")
    assert [choice.initial for choice in own.choices] == ["position", "attacked"]


def test_state_groups_stand_in_their_usual_order(campaign_page: Page) -> None:
    columns = ("variant", "position", "velocity", "acceleration", "whole state")
    assert table(campaign_page, "RMSE over all").columns == columns


def test_the_page_of_a_campaign_draws_and_can_be_read(browser: Browser, campaign_file: Path) -> None:
    with look_at(browser, campaign_file, width=390, scheme="light") as look:
        assert look.complaints == []
        assert look.requests == [campaign_file.as_uri()]
        assert look.overflow() <= 0
        assert look.smallest_text() >= 10.0
        assert look.empty_plots() == []


def test_a_page_of_few_trials_does_not_promise_what_resampling_does_not_keep(
    campaign: Path, campaign_page: Page, tmp_path: Path
) -> None:
    assert "Of 3 trials, those that are resampled (RMSE, bands) hold less often: " in campaign_page.facts
    request = Request(campaign.parent / "swept.yaml", 20, overrides=("steps=20",), out=tmp_path / "out")
    assert "resampled" not in page_for([sweep(prepare(request), QuietProgress())]).facts


def test_an_empty_source_is_refused_with_its_place(campaign: Path) -> None:
    source = load_source(campaign)

    class Empty(Source):
        """A source of which no trial is left."""

        table = source.table.slice(0, 0)

    with pytest.raises(ReportError, match="holds no trial that was scored"):
        find_groups([Chosen(Empty("run", "empty", campaign, {}), "", {0: {}})], None, [])
