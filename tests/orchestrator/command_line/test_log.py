"""`gauntlet log`: what a log holds, mended and handed on."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode

from orchestrator.log.reader import read_log
from tests.orchestrator.command_line.conftest import Command


@pytest.fixture
def cut_log(finished_run: Path, home: Path) -> Path:
    """A log that ends inside its last chunk."""
    whole = finished_run / "run.mcap"
    *_, last = read_log(whole).layout.of(Opcode.CHUNK)
    path = home / "cut.mcap"
    path.write_bytes(whole.read_bytes()[: last.offset + last.length // 2])
    return path


def test_info_tells_what_was_run_and_how_far_it_came(gauntlet: Command, finished_run: Path) -> None:
    answer = gauntlet("log", "info", finished_run / "run.mcap")
    assert answer.code == 0
    rows = dict(line.split(maxsplit=1) for line in answer.out.splitlines()[:8])
    assert rows["topology"].startswith("small, hash ")
    assert rows["seed"] == "7, trial 0"
    assert rows["steps"] == "24 of 24, 2.4 s simulated"
    assert rows["state"] == "complete"
    assert "       24  estimate/e3\n" in answer.out


def test_a_runs_directory_stands_for_its_log(gauntlet: Command, finished_run: Path, tmp_path: Path) -> None:
    log = finished_run / "run.mcap"
    for command in (("log", "info"), ("score",)):
        told, of_log = gauntlet(*command, finished_run), gauntlet(*command, log)
        assert (told.code, told.out) == (of_log.code, of_log.out)
    exported = gauntlet("log", "export", finished_run, "--out", tmp_path / "out")
    assert exported.code == 0
    empty = gauntlet("score", tmp_path)
    assert empty.code == 2
    assert f"{tmp_path} holds no run.mcap; give a log, or the directory of a run" in empty.err


def test_info_is_json_for_programs(gauntlet: Command, finished_run: Path) -> None:
    facts = gauntlet("log", "info", finished_run / "run.mcap", "--json").json()
    assert (facts["steps_recorded"], facts["complete"], facts["truncated"]) == (24, True, False)
    assert facts["score"] == json.loads((finished_run / "score.json").read_text())
    assert sum(facts["topics"].values()) == facts["messages"]


def test_info_of_a_log_that_was_cut_off_names_the_cure(gauntlet: Command, cut_log: Path) -> None:
    answer = gauntlet("log", "info", cut_log)
    assert answer.code == 0
    assert "cut off; `gauntlet log recover` makes it whole" in answer.out


@pytest.mark.parametrize("out", [None, "mended.mcap"])
def test_recover_writes_a_whole_log_beside_the_old_one(
    gauntlet: Command, cut_log: Path, home: Path, out: str | None
) -> None:
    before = cut_log.read_bytes()
    answer = gauntlet("log", "recover", cut_log, *(["--out", out] if out else []))
    path = home / (out or "cut.recovered.mcap")
    assert answer.code == 0
    assert answer.out.startswith(f"wrote {path if out is None else out}: ")
    assert cut_log.read_bytes() == before
    log = read_log(path)
    assert not log.truncated
    assert not log.complete
    assert gauntlet("score", path).out == gauntlet("score", cut_log).out


def test_recover_is_json_for_programs(gauntlet: Command, cut_log: Path, home: Path) -> None:
    facts = gauntlet("log", "recover", cut_log, "--json").json()
    assert facts["path"] == str(home / "cut.recovered.mcap")
    assert facts["whole_steps"] == 20
    assert facts["damaged_chunks"] == 0


def test_recover_leaves_a_whole_log_and_an_existing_file_alone(
    gauntlet: Command, cut_log: Path, finished_run: Path
) -> None:
    whole = gauntlet("log", "recover", finished_run / "run.mcap")
    assert (whole.code, "is whole; there is nothing to recover" in whole.err) == (2, True)
    taken = gauntlet("log", "recover", cut_log, "--out", "small.yaml")
    assert (taken.code, "small.yaml exists already" in taken.err) == (2, True)


@pytest.mark.parametrize(
    ("form", "names"),
    [
        ("csv", ["truth", "estimates", "detections", "packets", "links", "events"]),
        ("jsonl", ["messages"]),
        ("npz", ["log"]),
    ],
)
def test_export_writes_and_names_its_files(
    gauntlet: Command, finished_run: Path, home: Path, form: str, names: list[str]
) -> None:
    files = [f"data/{name}.{form}" for name in names]
    arguments = ("log", "export", finished_run / "run.mcap", "--format", form, "--out")
    answer = gauntlet(*arguments, "data")
    assert answer.code == 0
    assert answer.out == "".join(f"wrote {file}\n" for file in files)
    assert all((home / file).stat().st_size for file in files)
    assert gauntlet(*arguments, "again", "--json").json() == {
        "files": [file.replace("data", "again") for file in files]
    }


def test_exported_arrays_hold_the_run(gauntlet: Command, finished_run: Path, home: Path) -> None:
    gauntlet("log", "export", finished_run / "run.mcap", "--format", "npz", "--out", "data")
    with np.load(home / "data" / "log.npz") as arrays:
        assert arrays["truth"].shape == arrays["estimate/e1"].shape == (24, 3)
        assert arrays["step"].tolist() == list(range(24))


def test_export_does_not_overwrite(gauntlet: Command, finished_run: Path) -> None:
    arguments = ("log", "export", finished_run / "run.mcap", "--out", "data")
    assert gauntlet(*arguments).code == 0
    again = gauntlet(*arguments)
    assert again.code == 2
    assert "exists already; export to another folder" in again.err


def test_a_damaged_log_is_refused_with_its_cure(gauntlet: Command, finished_run: Path, home: Path) -> None:
    whole = finished_run / "run.mcap"
    _, second, _ = read_log(whole).layout.of(Opcode.CHUNK)
    damaged = bytearray(whole.read_bytes())
    damaged[second.offset + second.length // 2] ^= 0xFF
    (home / "damaged.mcap").write_bytes(damaged)
    for command in (("log", "info"), ("score",)):
        answer = gauntlet(*command, "damaged.mcap")
        assert answer.code == 2
        assert "gauntlet log recover damaged.mcap" in answer.err
    (home / "the damaged.mcap").write_bytes(damaged)
    assert "`gauntlet log recover 'the damaged.mcap'`" in gauntlet("score", "the damaged.mcap").err
    mended = gauntlet("log", "recover", "damaged.mcap")
    assert mended.code == 0
    assert "; damaged chunks that are lost: 1" in mended.out
