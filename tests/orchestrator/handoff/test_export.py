from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bus.messages import Estimate, Transmission, encode
from orchestrator.handoff.export import export
from orchestrator.log.errors import LogError
from orchestrator.log.reader import read_log


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
    (arrays,) = export(log, "npz", tmp_path)
    with np.load(arrays) as data:
        assert data["estimate/e1"].shape == (1, 3)
        assert np.isnan(data["estimate/e2"]).all()


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
