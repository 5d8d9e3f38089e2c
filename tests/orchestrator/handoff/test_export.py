from __future__ import annotations

import csv
import json
import resource
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from bus.messages import Estimate, Transmission, encode
from orchestrator.handoff import load
from orchestrator.handoff.export import export
from orchestrator.log.errors import LogError
from orchestrator.log.reader import read_log
from orchestrator.run import run_topology
from orchestrator.topology.load import load_topology


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_csv_holds_a_table_for_each_kind_to_the_last_bit(log_path: Path, tmp_path: Path) -> None:
    paths = export(log_path, "csv", tmp_path / "out")
    assert [path.name for path in paths] == [
        "truth.csv",
        "estimates.csv",
        "detections.csv",
        "packets.csv",
        "links.csv",
        "events.csv",
    ]
    rows = {path.stem: table(path) for path in paths}
    messages = list(read_log(log_path).records())
    truth = [message.state for topic, message in messages if topic == "truth/plant"]
    assert [[float(row[f"x{i}"]) for i in range(3)] for row in rows["truth"]] == truth
    assert [row["node"] for row in rows["estimates"][:3]] == ["e1", "e2", "e3"]
    assert float(rows["estimates"][0]["sigma2"]) == 1.0
    assert len(rows["packets"]) == sum("x/" in topic for topic, _ in messages)
    assert {row["direction"] for row in rows["packets"]} == {"tx", "rx"}
    assert {row["stream"] for row in rows["packets"]} == {"measurement", "exchange"}
    assert [row["lost"] for row in rows["links"][:2]] == ["0", "1"]
    assert {row["action"] for row in rows["events"]} == {"lost", "attacked"}
    assert {row["alarm"] for row in rows["detections"]} == {"False"}


def test_quiet_slots_have_no_packets_and_diverged_estimates_no_numbers(ring: Any, tmp_path: Path) -> None:
    plan = ring.plan(steps=1, rounds=0)
    traffic = ring.traffic(plan)
    quiet = Transmission(step=0, t=0.0, round=0, sequence=[], offset=[], values=[])
    lists = {name: [] for name in Estimate.__struct_fields__}
    told = {"step": 0, "t": 0.0, "refers_to": 0, "diverged": True, "nis": 0.0, "nis_dof": 0, "refused": 0}
    diverged = Estimate(**{**lists, **told})
    replaced = {"tx/s1/measurement": quiet, "estimate/e2": diverged}
    traffic = [
        (topic, round_, step, encode(replaced[topic]) if topic in replaced else payload)
        for topic, round_, step, payload in traffic
    ]
    log = ring.write(tmp_path / "run.mcap", plan, traffic)
    paths = {path.stem: path for path in export(log, "csv", tmp_path)}
    assert "s1" not in {row["node"] for row in table(paths["packets"])}
    row = table(paths["estimates"])[1]
    assert (row["node"], row["diverged"], row["x0"], row["sigma2"]) == ("e2", "True", "", "")
    assert (row["cov0_0"], row["cov2_2"], row["nis"], row["nis_dof"]) == ("", "", "", "0")
    (arrays,) = export(log, "npz", tmp_path)
    with np.load(arrays) as data:
        assert data["estimate/e1"].shape == (1, 3)
        assert np.isnan(data["estimate/e2"]).all()
        assert np.isnan(data["covariance/e2"]).all()
        assert np.isnan(data["nis/e2"]).all()


def test_json_lines_hold_every_message_with_its_topic(
    log_path: Path, tmp_path: Path, traffic: list[Any]
) -> None:
    (path,) = export(log_path, "jsonl", tmp_path)
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert lines == [{"topic": topic, "message": json.loads(payload)} for topic, _, _, payload in traffic]


def test_npz_holds_a_row_a_step(log_path: Path, tmp_path: Path) -> None:
    (path,) = export(log_path, "npz", tmp_path)
    messages = list(read_log(log_path).records())
    with np.load(path) as data:
        assert data["step"].tolist() == list(range(6))
        assert data["truth"].tolist() == [m.state for topic, m in messages if topic == "truth/plant"]
        assert data["estimate/e3"].tolist() == [m.state for topic, m in messages if topic == "estimate/e3"]
        assert data["sigma/e1"].shape == (6, 3)
        assert data["nis/e1"].shape == data["refers_to/e1"].shape == data["t"].shape == (6,)


@pytest.fixture(scope="module")
def outage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a run whose packets are lost for a while and whose plant is steered."""
    folder = tmp_path_factory.mktemp("outage")
    (folder / "steered.yaml").write_text(STEERED)
    run_topology(load_topology(folder / "steered.yaml"), folder, "inprocess", lambda recorded: None)
    return folder / "run.mcap"


STEERED = """
name: steered
period_s: 0.1
steps: 20
plant:
  model: linear
  A: [[1.0, 0.1], [0.0, 1.0]]
  B: [[0.005], [0.1]]
  process_noise: {std: [0.001, 0.02]}
  initial: {std: [0.1, 0.1]}
sensors:
  s1: {model: linear, C: [[1.0, 0.0]], noise: {std: 0.01}}
estimators:
  e1: {method: kalman}
controllers:
  c1: {law: lqr, estimator: e1, state_weight: [1.0, 0.1], input_weight: [0.1], reference: [1.0, 0.0]}
channel:
  s1->e1: [{outage: {windows: [[5, 9]]}}]
"""


def test_there_is_no_nis_where_no_packet_came(outage: Path, tmp_path: Path) -> None:
    lost = [5 <= step <= 9 for step in range(20)]
    (path,) = export(outage, "npz", tmp_path)
    with np.load(path) as data:
        assert np.isnan(data["nis/e1"]).tolist() == lost
        assert (data["nis_dof/e1"] == 0).tolist() == lost
    paths = {path.stem: path for path in export(outage, "csv", tmp_path)}
    rows = table(paths["estimates"])
    assert [row["nis"] == "" for row in rows] == lost
    assert [row["nis_dof"] == "0" for row in rows] == lost


def test_the_covariance_is_handed_on_so_that_nees_can_be_computed_again(outage: Path, tmp_path: Path) -> None:
    nees = load(outage).errors["nees"].to_numpy()
    (path,) = export(outage, "npz", tmp_path)
    with np.load(path) as data:
        error, P = data["estimate/e1"] - data["truth"], data["covariance/e1"]
    assert P.shape == (20, 2, 2)
    again = np.einsum("ki,kij,kj->k", error, np.linalg.inv(P), error)
    np.testing.assert_allclose(again, nees, rtol=1e-9)
    estimates, *_ = [path for path in export(outage, "parquet", tmp_path) if path.stem == "estimates"]
    listed = np.stack(pl.read_parquet(estimates)["covariance"].to_list()).reshape(20, 2, 2)
    np.testing.assert_array_equal(listed, P)
    _, estimates, *_ = export(outage, "csv", tmp_path)
    upper = [[float(row[f"cov{i}_{j}"]) for i, j in ((0, 0), (0, 1), (1, 1))] for row in table(estimates)]
    np.testing.assert_array_equal(upper, P[:, [0, 0, 1], [0, 1, 1]])


def test_csv_tells_the_input_the_method_and_what_was_refused(outage: Path, tmp_path: Path) -> None:
    paths = {path.stem: path for path in export(outage, "csv", tmp_path)}
    truth = [message for topic, message in read_log(outage).records() if topic == "truth/plant"]
    assert [row["control0"] for row in table(paths["truth"])] == [
        *("".join(map(repr, message.control)) for message in truth)
    ]
    assert table(paths["truth"])[0]["control0"] == ""
    rows = table(paths["estimates"])
    assert {row["method"] for row in rows} == {"kalman"}
    assert {row["refused"] for row in rows} == {"0"}


@pytest.mark.parametrize(("form", "taken"), [("csv", "events.csv"), ("parquet", "errors.parquet")])
def test_an_export_that_is_refused_leaves_nothing_of_itself(
    outage: Path, tmp_path: Path, form: Any, taken: str
) -> None:
    (tmp_path / taken).write_text("mine")
    with pytest.raises(LogError, match=f"{taken} exists already; export to another folder"):
        export(outage, form, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [taken]
    assert (tmp_path / taken).read_text() == "mine"


@pytest.fixture
def small_files() -> Iterator[None]:
    """No file may grow beyond a few hundred bytes: as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (400, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.usefixtures("small_files")
@pytest.mark.parametrize("form", ["csv", "jsonl", "npz", "parquet"])
def test_an_export_that_fails_half_way_leaves_nothing_of_itself(
    outage: Path, tmp_path: Path, form: Any
) -> None:
    for out in (tmp_path, tmp_path / "new"):
        with pytest.raises(LogError, match=f"{out} cannot be written: .*; export to another folder"):
            export(outage, form, out)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("form", ["csv", "jsonl", "npz"])
def test_nothing_is_overwritten(log_path: Path, tmp_path: Path, form: Any) -> None:
    first, *_ = export(log_path, form, tmp_path)
    content = first.read_bytes()
    with pytest.raises(LogError, match="exists already; export to another folder"):
        export(log_path, form, tmp_path)
    assert first.read_bytes() == content


def test_an_unknown_format_is_told_with_the_known_ones(log_path: Path, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="there is no format 'xlsx'; take one of csv, jsonl, npz, parquet"):
        export(log_path, "xlsx", tmp_path)


def test_a_folder_that_cannot_be_made_is_told(log_path: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(LogError, match="export to another folder"):
        export(log_path, "csv", tmp_path / "file" / "out")
