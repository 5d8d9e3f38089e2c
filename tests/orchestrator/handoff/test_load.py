from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from mcap.opcode import Opcode

from bus.messages import Estimate
from orchestrator.errors import InputError
from orchestrator.handoff import load
from orchestrator.handoff.columns import component_names
from orchestrator.handoff.run import TABLES
from orchestrator.log.reader import read_log
from orchestrator.score_of_log import score_of_log


@pytest.fixture(scope="module")
def run(home: Path) -> Any:
    return load(home / "run")


@pytest.fixture(scope="module")
def messages(home: Path) -> list[Any]:
    return list(read_log(home / "run" / "run.mcap").records())


def test_a_run_is_found_by_its_folder_or_its_log(home: Path) -> None:
    by_folder, by_log = load(home / "run"), load(str(home / "run" / "run.mcap"))
    assert by_folder.kind == by_log.kind == "run"
    assert (by_folder.name, by_folder.seed) == ("small", 7)
    assert by_folder.truth.equals(by_log.truth)
    assert "small, seed 7" in repr(by_folder)
    assert by_folder.provenance["seed"] == "7"
    assert by_folder.topology["plant"]["model"] == "constant_acceleration"


def test_truth_and_estimates_are_those_of_the_record_to_the_last_bit(run: Any, messages: list[Any]) -> None:
    state = ["position", "velocity", "acceleration"]
    truth = [message.state for topic, message in messages if topic == "truth/plant"]
    assert run.truth.select(state).to_numpy().tolist() == truth
    estimates = [(topic, message) for topic, message in messages if isinstance(message, Estimate)]
    assert run.estimates["node"].to_list() == [topic.split("/")[1] for topic, _ in estimates]
    assert run.estimates.select(state).to_numpy().tolist() == [own.state for _, own in estimates]
    sigma = run.estimates.select([f"sigma_{name}" for name in state]).to_numpy().tolist()
    assert sigma == [own.sigma for _, own in estimates]
    assert run.estimates["covariance"].to_list() == [own.covariance for _, own in estimates]
    assert run.estimates["step"].to_list() == [own.step for _, own in estimates]


def test_columns_have_their_types_whatever_they_hold(run: Any) -> None:
    assert run.estimates.schema["step"] == pl.Int64
    assert run.estimates.schema["diverged"] == pl.Boolean
    assert run.estimates.schema["method"] == pl.String
    assert run.packets.schema["values"] == pl.List(pl.Float64)
    assert run.truth.schema["control"] == pl.List(pl.Float64)
    assert run.events.schema["magnitude"] == pl.Float64
    assert set(run.packets["direction"]) == {"tx", "rx"}
    assert set(run.events["action"]) == {"lost", "attacked"}


def test_packets_links_and_events_add_up_to_the_score(run: Any) -> None:
    score = run.score
    assert run.links["sent"].sum() == score.traffic.sent
    assert run.links["lost"].sum() == score.traffic.lost == (run.events["action"] == "lost").sum()
    assert (run.packets["direction"] == "rx").sum() == score.traffic.delivered
    assert (run.events["action"] == "attacked").sum() == score.traffic.attacked == 6


def test_errors_are_those_that_the_score_averages(run: Any, home: Path) -> None:
    score = score_of_log(home / "run" / "run.mcap")
    counted = run.errors.filter(pl.col("step") >= 4)
    by_node = counted.group_by("node").agg(pl.col("position").pow(2).mean().sqrt(), pl.col("nees").mean())
    for node in score.nodes:
        ((_, rmse, nees),) = by_node.filter(pl.col("node") == node.name).rows()
        assert rmse == pytest.approx(node.groups["position"].rmse, rel=1e-12)
        assert nees == pytest.approx(node.nees.mean, rel=1e-12)
    assert run.errors["t"].to_list() == pytest.approx((run.errors["step"] * 0.1).to_list())
    attacked = run.errors.filter(pl.col("attacked"))
    assert attacked["node"].unique().to_list() == ["e2"]
    assert attacked["step"].to_list() == list(range(10, 16))
    (window,) = run.windows.rows(named=True)
    assert (window["link"], window["first"], window["last"]) == ("s2->e2", 10, 15)
    assert run.detections.filter(pl.col("attacked"))["link"].unique().to_list() == ["s2->e2"]
    assert run.results["node"].to_list() == [node.name for node in score.nodes]
    assert run.results["rmse.position"].to_list() == [node.groups["position"].rmse for node in score.nodes]


def test_arrays_are_labelled_and_agree_with_the_frames(run: Any) -> None:
    arrays = run.arrays
    assert dict(arrays.sizes) == {"node": 4, "step": 24, "component": 3, "other_component": 3, "group": 4}
    assert arrays.component.values.tolist() == ["position", "velocity", "acceleration"]
    assert arrays.method.sel(node="lone").item() == "kalman"
    of_e2 = run.estimates.filter(pl.col("node") == "e2")
    assert arrays.estimate.sel(node="e2", component="velocity").values.tolist() == of_e2["velocity"].to_list()
    assert arrays.sigma.sel(node="e2", component="velocity").values.tolist() == (
        of_e2["sigma_velocity"].to_list()
    )
    np.testing.assert_array_equal(arrays.error, arrays.estimate - arrays.truth)
    np.testing.assert_allclose(
        arrays.error_norm.sel(group="state"), np.sqrt((arrays.error**2).sum("component")), rtol=1e-12
    )
    variances = arrays.covariance.sel(component="position", other_component="position")
    np.testing.assert_allclose(np.sqrt(variances), arrays.sigma.sel(component="position"), rtol=1e-12)
    of_lone = run.errors.filter(pl.col("node") == "lone")
    assert arrays.sent.sel(node="lone").values.tolist() == of_lone["sent"].to_list()
    bound = arrays.bound.sel(node="lone", group="position").values
    np.testing.assert_array_equal(bound, of_lone["bound_position"].to_numpy())
    assert np.isfinite(bound).any()
    assert arrays.attrs["seed"] == 7
    assert arrays.t.sel(step=10).item() == pytest.approx(1.0)


def test_pandas_gives_the_same_frames_as_polars(home: Path, run: Any) -> None:
    other = load(home / "run", frames="pandas")
    for name in TABLES:
        ours, theirs = getattr(run, name), getattr(other, name)
        assert list(theirs.columns) == ours.columns
        assert len(theirs) == len(ours)
    assert other.estimates["position"].tolist() == run.estimates["position"].to_list()
    assert other.estimates.dtypes["step"] == np.int64


def test_an_estimator_that_diverged_has_no_numbers_there(home: Path, tmp_path: Path) -> None:
    (tmp_path / "diverging.py").write_text(
        "import numpy as np\nfrom nodes.contract import Belief\n\n\nclass Diverging:\n"
        "    rounds = 0\n\n    def __init__(self, setting): ...\n    def correct(self, step, packets): ...\n"
        "    def exchange(self, step, round_, packets): ...\n    def estimate(self, step):\n"
        "        return Belief(state=np.full(3, np.inf if step > 5 else 0.0), covariance=np.eye(3))\n"
    )
    from orchestrator.run import run_topology
    from orchestrator.topology.load import load_topology

    override = f"estimators.lone.method={tmp_path / 'diverging.py'}:Diverging"
    (tmp_path / "run").mkdir()
    topology = load_topology(home / "small.yaml", [override])
    run_topology(topology, tmp_path / "run", "inprocess", lambda recorded: None)
    run = load(tmp_path / "run")
    mine = run.estimates.filter(pl.col("node") == "lone")
    assert mine["position"].is_null().to_list() == [step > 5 for step in range(24)]
    assert mine["covariance"].is_null().to_list() == [step > 5 for step in range(24)]
    assert mine["diverged"].to_list() == [step > 5 for step in range(24)]
    assert np.isnan(run.arrays.estimate.sel(node="lone", component="position")).sum() == 18
    assert run.results.filter(pl.col("node") == "lone")["divergence_step"].to_list() == [6]


def test_a_log_that_was_cut_off_is_loaded_as_far_as_it_goes(home: Path, tmp_path: Path) -> None:
    log = home / "run" / "run.mcap"
    last_chunk = read_log(log).layout.of(Opcode.CHUNK)[-1]
    (tmp_path / "run.mcap").write_bytes(log.read_bytes()[: last_chunk.offset + 100])
    run = load(tmp_path)
    assert 0 < len(run.truth) < 24
    assert run.arrays.sizes["step"] == 24
    assert np.isnan(run.arrays.truth[-1]).all()


def test_a_campaign_has_its_trials_by_variant(campaign: Path) -> None:
    held = load(campaign)
    assert held.kind == "campaign"
    assert load(campaign / "results.parquet").results.equals(held.results)
    failed = held.results.filter(pl.col("status") == "failed")
    assert failed["variant"].to_list() == [1, 1, 1]
    assert "ArithmeticError" in failed["message"][0]
    scored = held.results.filter(pl.col("status") == "scored")
    assert scored["trial"].to_list() == [trial for trial in range(3) for _ in range(4)]
    assert scored["set.estimators.lone.method"].unique().to_list() == ["kalman"]
    assert len(held.topologies) == 2
    errors = held.errors.filter(pl.col("node") == "e1", pl.col("trial") == 2, pl.col("step") >= 4)
    of_e1 = scored.filter(pl.col("node") == "e1", pl.col("trial") == 2)
    assert errors["position"].pow(2).mean() ** 0.5 == pytest.approx(of_e1["rmse.position"][0], rel=1e-12)
    assert set(held.detections["link"]) >= {"s1->e1", "s2->e2"}
    assert held.windows["trial"].to_list() == [0, 1, 2]


def test_arrays_of_a_campaign_are_labelled_and_empty_where_trials_failed(campaign: Path) -> None:
    held = load(campaign, "pandas")
    arrays = held.arrays
    assert dict(arrays.sizes) == {"variant": 2, "trial": 3, "node": 4, "step": 24, "group": 4}
    assert arrays.error_norm.sel(variant=1).isnull().all()
    one = held.errors[(held.errors.trial == 1) & (held.errors.node == "lone")]
    picked = arrays.error_norm.sel(variant=0, trial=1, node="lone", group="velocity")
    assert picked.values.tolist() == one["velocity"].tolist()
    assert arrays.attacked.sel(variant=0, trial=0, node="e2").sum() == 6


def test_a_campaign_says_where_to_find_what_it_does_not_keep(campaign: Path) -> None:
    held = load(campaign)
    with pytest.raises(
        InputError, match="keeps no estimates; write the log of a trial with `gauntlet replay"
    ):
        _ = held.estimates
    with pytest.raises(AttributeError, match="it has errors, detections, windows, results and arrays"):
        _ = held.nothing


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nowhere", "give the directory of a run or a campaign"),
        ("empty", "give the directory of a run or a campaign"),
        ("notes.mcap", "not a log of gauntlet|not an MCAP"),
        ("unfinished", "unfinished campaign"),
    ],
)
def test_a_path_that_leads_to_no_results_is_refused_with_the_cure(
    tmp_path: Path, campaign: Path, name: str, words: str
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.mcap").write_text("nothing of the kind")
    shutil.copytree(campaign, tmp_path / "unfinished")
    (tmp_path / "unfinished" / "results.parquet").unlink()
    with pytest.raises(InputError, match=words):
        load(tmp_path / name)


def test_frames_of_another_kind_and_missing_packages_are_told(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="take one of polars, pandas"):
        load(home / "run", "excel")  # type: ignore[arg-type]
    monkeypatch.setitem(sys.modules, "polars", None)
    with pytest.raises(InputError, match=r"pip install -e '\.\[frames\]' in a checkout"):
        load(home / "run")
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match="xarray is missing"):
        _ = load(home / "run", "pandas").arrays


@pytest.mark.parametrize(
    ("groups", "size", "names"),
    [
        ({"position": [0], "velocity": [1]}, 2, ["position", "velocity"]),
        ({"lower": [0, 1], "upper": [2, 3]}, 4, ["lower_0", "lower_1", "upper_0", "upper_1"]),
        ({"part": [2]}, 3, ["x0", "x1", "part"]),
        ({"a": [0, 1], "b": [1]}, 2, ["a_0", "a_1"]),
        ({"step": [0], "a_0": [1], "a": [2, 3]}, 4, ["x0", "x1", "x2", "a_1"]),
        ({}, 0, []),
    ],
)
def test_components_are_named_by_their_groups_and_never_twice(
    groups: dict[str, list[int]], size: int, names: list[str]
) -> None:
    assert component_names(groups, size) == names
