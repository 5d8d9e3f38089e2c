"""The same campaign on a Dask cluster: a real scheduler with two worker processes, and the same bytes."""

from __future__ import annotations

from collections.abc import Iterator

import pyarrow.compute as pc
import pytest

from orchestrator import exit_codes
from orchestrator.errors import InputError
from tests.orchestrator.campaign.conftest import Home, table_of

distributed = pytest.importorskip("distributed")

GRID = "channel...failure=0.05,0.4"


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
    ) as cluster:
        yield cluster.scheduler_address


def test_a_cluster_gives_the_same_bytes(home: Home, address: str) -> None:
    here, _ = home.sweep("here", 6, GRID, workers=2)
    there, heard = home.sweep("there", 6, GRID, dask=address)
    assert sum(heard.finished) == 12
    assert (here / "results.parquet").read_bytes() == (there / "results.parquet").read_bytes()


def test_a_campaign_that_began_here_goes_on_there(home: Home, address: str) -> None:
    whole, _ = home.sweep("whole", 4)
    home.sweep("out", 2)
    out, heard = home.sweep("out", 4, dask=address)
    assert heard.done == 2
    assert (whole / "results.parquet").read_bytes() == (out / "results.parquet").read_bytes()


def test_failed_trials_are_recorded_there_too(home: Home, address: str) -> None:
    moody = f"estimators.e1.method={home.folder / 'moody.py'}:Moody"
    out, heard = home.sweep("out", 6, moody, dask=address)
    rows = table_of(out)
    failed = rows.filter(pc.equal(rows["status"], "failed"))
    assert heard.failed == failed.num_rows > 0
    assert set(failed["message"].to_pylist()) == {"e1 failed in step 3: ValueError: not today"}


def test_a_scheduler_that_does_not_answer_is_told_with_its_address(
    home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("orchestrator.campaign.dask_workers._CONNECT_S", 0.5)
    with pytest.raises(InputError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:1"):
        home.sweep("out", 1, dask="tcp://127.0.0.1:1")


@pytest.mark.parametrize("address", ["nonsense", "nonsense://x", "tcp://localhost"])
def test_an_address_that_is_none_is_told_at_once_and_in_one_message(home: Home, address: str) -> None:
    told = home.command("sweep", "small.yaml", "--trials", "1", "--out", "out", "--dask", address)
    assert told.returncode == exit_codes.BAD_INPUT
    assert f"no Dask scheduler answers at {address}; start one with" in told.stderr
    assert "Traceback" not in told.stderr
