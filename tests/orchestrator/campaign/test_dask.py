"""The same campaign on a Dask cluster: a real scheduler with two worker processes, and the same bytes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow.compute as pc
import pytest

from orchestrator import exit_codes
from orchestrator.backends.contract import RunFailedError
from orchestrator.errors import InputError
from tests.orchestrator.campaign.conftest import (
    COMMAND,
    MOODY,
    PATIENCE_S,
    ROOT,
    Home,
    environment,
    table_of,
    wait_until,
)

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")

GRID = "channel...failure=0.05,0.4"


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0", memory_limit=0
    ) as own:
        yield own.scheduler_address


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with cluster(2) as own:
        yield own


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


@pytest.mark.parametrize("temper", ["raise", "kill"])
def test_failed_trials_are_the_same_bytes_there_and_their_tracebacks_are_kept_here(
    home: Home, address: str, temper: str
) -> None:
    moody = f"estimators.e1={{method: {home.folder / 'moody.py'}:Moody, temper: {temper}}}"
    here, _ = home.sweep("here", 6, moody, workers=2)
    there, heard = home.sweep("there", 6, moody, dask=address)
    assert 0 < heard.failed < 6
    assert (here / "results.parquet").read_bytes() == (there / "results.parquet").read_bytes()
    logs = [log.read_text() for log in (there / "workers").glob("*.log")]
    assert any("ValueError: not today" in log for log in logs) is (temper == "raise")


def test_a_trial_that_hangs_there_is_given_up_and_the_others_are_not(home: Home, address: str) -> None:
    moody = f"estimators.e1={{method: {home.folder / 'moody.py'}:Moody, temper: hang}}"
    out, heard = home.sweep("out", 4, moody, dask=address, trial_timeout_s=4.0)
    assert messages(out) == {"it took longer than 4 s, twice; see --trial-timeout"}
    assert 0 < heard.failed < 4


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_sweep_that_was_ended_leaves_the_cluster_free_for_the_next(
    home: Home, address: str, how: signal.Signals
) -> None:
    moody = f"estimators.e*={{method: {home.folder / 'moody.py'}:Moody, temper: hang}}"
    options = ("--set", moody, "--set", "channel=null", "--dask", address)
    process = subprocess.Popen(
        [*COMMAND, "sweep", "small.yaml", "--trials", "20", "--out", "out", *options],
        cwd=home.folder,
        env=environment(),
    )
    try:
        wait_until((home.folder / "hangs").exists, "a trial hangs")
        time.sleep(2.0)  # so that another may hang too
        process.send_signal(how)
        process.wait(PATIENCE_S)
    finally:
        process.kill()
    begun = time.monotonic()
    _, heard = home.sweep("next", 6, dask=address)
    assert (sum(heard.finished), heard.failed) == (6, 0)
    assert time.monotonic() - begun < 40.0


def test_only_the_trial_that_ends_workers_of_dask_is_blamed(home: Home) -> None:
    moody = f"estimators.e1={{method: {home.folder / 'moody.py'}:Moody, temper: %s}}"
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}), cluster(2) as address:
        out, _ = home.sweep("out", 6, moody % "kill the parent", dask=address)
    raising, _ = home.sweep("raising", 6, moody % "raise")
    assert failed(out) == failed(raising) != []
    assert messages(out) == {"its worker of the Dask cluster ended, time and again"}


def test_a_cluster_without_workers_is_told_and_what_was_done_is_kept(
    home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("orchestrator.campaign.dask_workers._LOOK_S", 0.2)
    monkeypatch.setattr("orchestrator.campaign.dask_workers._DESERTED_S", 2.0)
    moody = f"estimators.e1={{method: {home.folder / 'moody.py'}:Moody, temper: kill the parent}}"
    first = first_bad(home) - 1
    with lone_worker(home) as address:
        out, _ = home.sweep("out", 1, moody, dask=address, first_trial=first)
        with pytest.raises(RunFailedError, match="it has no worker left; the finished trials are kept"):
            home.sweep("out", 6, moody, dask=address, first_trial=first)
    assert set(table_of(out)["trial"].to_pylist()) == {first}


def test_a_worker_with_other_code_is_refused(home: Home, monkeypatch: pytest.MonkeyPatch) -> None:
    for place in (home.folder, home.folder / "there"):
        (place / "tempers").mkdir(parents=True)
        (place / "tempers" / "__init__.py").write_text("")
        (place / "tempers" / "moody.py").write_text(MOODY)
    monkeypatch.syspath_prepend(home.folder)
    moody = "estimators.e1.method=tempers.moody:Moody"
    with lone_worker(home, home.folder / "there") as address:
        home.sweep("same", 2, moody, dask=address)
        (home.folder / "there" / "tempers" / "moody.py").write_text(MOODY + "# changed")
        with pytest.raises(InputError, match=r"worker 127.0.0.1-\d+-1 has other code of tempers.moody"):
            home.sweep("other", 2, moody, dask=address)
        (home.folder / "there" / "tempers" / "moody.py").unlink()
        with pytest.raises(InputError, match="cannot load its classes"):
            home.sweep("none", 2, moody, dask=address)


def failed(out: Path) -> list[int]:
    rows = table_of(out)
    found: list[int] = rows.filter(pc.equal(rows["status"], "failed"))["trial"].to_pylist()
    return found


def messages(out: Path) -> set[str]:
    rows = table_of(out)
    return set(rows.filter(pc.equal(rows["status"], "failed"))["message"].to_pylist())


def first_bad(home: Home) -> int:
    """The first trial but 0 in which the moody estimator does something foolish."""
    out, _ = home.sweep("moods", 12, "estimators.e1.method=./moody.py:Moody")
    return next(trial for trial in failed(out) if trial)


@contextmanager
def lone_worker(home: Home, *places: Path) -> Iterator[str]:
    """A cluster of one worker that nobody starts again."""
    elsewhere = home.folder / "elsewhere"
    elsewhere.mkdir()
    path = os.pathsep.join([*map(str, places), str(ROOT)])
    with cluster(0) as address:
        worker = subprocess.Popen(
            [
                *(sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-nanny"),
                *("--nthreads", "1", "--no-dashboard", "--memory-limit", "0"),
            ],
            cwd=elsewhere,
            env={**os.environ, "PYTHONPATH": path},
            stderr=subprocess.DEVNULL,
        )
        try:
            with distributed.Client(address, set_as_default=False) as client:
                client.wait_for_workers(1, timeout=PATIENCE_S)
            yield address
        finally:
            worker.kill()
            worker.wait(PATIENCE_S)


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
