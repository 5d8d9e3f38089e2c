"""`gauntlet log export --format parquet`."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from orchestrator.handoff import load
from orchestrator.handoff.export import export
from orchestrator.handoff.run import TABLES
from orchestrator.log.errors import LogError


def test_parquet_holds_every_frame_with_its_types(home: Path, tmp_path: Path) -> None:
    run = load(home / "run")
    paths = export(home / "run" / "run.mcap", "parquet", tmp_path / "out")
    assert [path.name for path in paths] == [f"{name}.parquet" for name in TABLES]
    for path in paths:
        held = pl.read_parquet(path)
        assert held.schema == getattr(run, path.stem).schema
        assert held.equals(getattr(run, path.stem))


def test_the_same_log_gives_the_same_files_and_overwrites_none(home: Path, tmp_path: Path) -> None:
    log = home / "run" / "run.mcap"
    first, second = (export(log, "parquet", tmp_path / name) for name in ("a", "b"))
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    with pytest.raises(LogError, match="exists already; export to another folder"):
        export(log, "parquet", tmp_path / "a")
