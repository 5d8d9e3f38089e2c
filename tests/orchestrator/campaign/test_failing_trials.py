"""Trials that fail: by their code, with their worker, or by time; real processes, every wait bounded."""

from __future__ import annotations

import subprocess
import time
from typing import Any

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from tests.orchestrator.campaign.conftest import (
    COMMAND,
    PATIENCE_S,
    Home,
    environment,
    same_bytes,
    table_of,
    wait_until,
    workers_of,
)


def test_failed_trials_are_counted_with_their_reason_and_the_exit_code_tells(home: Home) -> None:
    done = home.command(
        *("sweep", "small.yaml", "--trials", "8", "-j", "1", "--out", "out", "--json"),
        *("--set", "estimators.e1.method=./moody.py:Moody"),
    )
    assert done.returncode == 3, done.stderr
    rows = table_of(home.folder / "out")
    failed = rows.filter(pc.equal(rows["status"], "failed"))
    assert 0 < failed.num_rows < 8
    assert set(failed["message"].to_pylist()) == {"e1 failed in step 3: ValueError: not today"}
    assert set(failed["node"].to_pylist()) == {""}
    assert set(failed["rmse.state"].to_pylist()) == {None}
    assert len({*rows["trial"].to_pylist()}) == 8
    assert "not today" in (home.folder / "out" / "workers" / "1.log").read_text()


def test_a_trial_that_kills_its_worker_is_tried_twice_and_recorded_as_failed(home: Home) -> None:
    out, heard = home.sweep("out", 8, "estimators.e1={method: ./moody.py:Moody, temper: kill}", workers=2)
    rows = table_of(out)
    failed = rows.filter(pc.equal(rows["status"], "failed"))
    raising, _ = home.sweep("raising", 8, "estimators.e1.method=./moody.py:Moody", workers=2)
    foolish = table_of(raising)
    foolish = foolish.filter(pc.equal(foolish["status"], "failed"))
    assert failed["trial"].to_pylist() == foolish["trial"].to_pylist() != []
    assert heard.failed == failed.num_rows
    assert set(failed["message"].to_pylist()) == {"its worker was ended twice by SIGKILL (out of memory?)"}
    timing = pq.read_table(out / "timing.parquet").to_pylist()
    times = ("wall_s", "cpu_s", "step_p50_s", "step_p95_s")
    of_failed = [row for row in timing if row["trial"] in failed["trial"].to_pylist()]
    assert {row[name] for row in of_failed for name in times} == {None}
    assert all(row[name] > 0.0 for row in timing if row not in of_failed for name in times)


def test_a_trial_that_hangs_is_given_up_and_the_others_are_not(home: Home) -> None:
    moody = "estimators.e1={method: ./moody.py:Moody, temper: hang}"
    out, heard = home.sweep("out", 4, moody, workers=2, trial_timeout_s=4.0)
    rows = table_of(out)
    failed = rows.filter(pc.equal(rows["status"], "failed"))
    assert 0 < failed.num_rows == heard.failed < 4
    assert set(failed["message"].to_pylist()) == {"it took longer than 4 s, twice; see --trial-timeout"}


@pytest.mark.parametrize(
    ("temper", "message"),
    [
        ("fork", "its worker was ended twice by SIGKILL (out of memory?)"),
        ("fork and hang", "it took longer than 3 s, twice; see --trial-timeout"),
    ],
)
def test_the_end_of_a_worker_is_noticed_and_ends_what_its_trial_forked(
    home: Home, temper: str, message: str
) -> None:
    begun = time.monotonic()
    moody = f"estimators.e1={{method: ./moody.py:Moody, temper: {temper}}}"
    out, heard = home.sweep("out", 4, moody, workers=2, trial_timeout_s=3.0)
    assert time.monotonic() - begun < 45.0  # what was forked lives for a minute
    wait_until(lambda: not workers_of(out), "nothing that holds the workers' logs open is left")
    failed = table_of(out).filter(pc.equal(table_of(out)["status"], "failed"))
    assert set(failed["message"].to_pylist()) == {message}
    assert 0 < failed.num_rows == heard.failed < 4


def test_what_a_trial_forked_does_not_outlive_a_sweep_that_was_killed(home: Home) -> None:
    moody = "estimators.e1={method: ./moody.py:Moody, temper: fork and hang}"
    process = subprocess.Popen(
        [*COMMAND, "sweep", "small.yaml", "--trials", "8", "-j", "2", "--out", "out", "--set", moody],
        cwd=home.folder,
        env=environment(),
        stderr=subprocess.DEVNULL,
    )
    out = home.folder / "out"
    try:
        wait_until(lambda: len(workers_of(out)) > 2, "a trial has forked")
    finally:
        process.kill()
        process.wait(PATIENCE_S)
    begun = time.monotonic()
    wait_until(lambda: not workers_of(out), "nothing is left")
    assert time.monotonic() - begun < 20.0  # what was forked lives for a minute


@pytest.mark.parametrize(
    ("temper", "patience_s", "busy_sweeps"), [("hang while busy", 5.0, 1), ("kill while busy", 60.0, 2)]
)
def test_trials_that_the_machine_lost_are_tried_anew_and_the_results_are_as_if_none_had_been(
    home: Home, temper: str, patience_s: float, busy_sweeps: int
) -> None:
    moody = f"estimators.e1={{method: ./moody.py:Moody, temper: {temper}}}"
    whole, heard = home.sweep("whole", 6, moody, workers=2)
    assert not heard.failed
    (home.folder / "busy").touch()
    done, lost = 0, 6
    for _ in range(busy_sweeps):
        _, heard = home.sweep("out", 6, moody, workers=2, trial_timeout_s=patience_s)
        assert (heard.done, sum(heard.finished)) == (done, lost)
        assert 0 < heard.failed < 6
        done, lost = 6 - heard.failed, heard.failed
    (home.folder / "busy").unlink()
    out, heard = home.sweep("out", 6, moody, workers=2)
    assert (heard.done, sum(heard.finished), heard.failed) == (done, lost, 0)
    assert same_bytes(whole, out)


def test_a_lost_trial_of_a_sweep_that_was_killed_is_tried_anew(
    home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    moody = "estimators.e1={method: ./moody.py:Moody, temper: kill while busy}"
    whole, _ = home.sweep("whole", 6, moody, workers=2)
    (home.folder / "busy").touch()
    with monkeypatch.context() as patched:
        patched.setattr("orchestrator.campaign.sweep.write_results", _killed)
        with pytest.raises(KeyboardInterrupt):
            home.sweep("out", 6, moody, workers=2)
    (home.folder / "busy").unlink()
    out, heard = home.sweep("out", 6, moody, workers=2)
    assert 0 < sum(heard.finished) < 6
    assert same_bytes(whole, out)


def _killed(*_: Any) -> None:
    raise KeyboardInterrupt


def test_trials_whose_code_failed_are_not_tried_anew(home: Home) -> None:
    moody = "estimators.e1={method: ./moody.py:Moody, temper: raise}"
    _, heard = home.sweep("out", 6, moody, workers=2)
    assert heard.failed
    _, heard = home.sweep("out", 6, moody, workers=2)
    assert (heard.done, heard.finished) == (6, [])
