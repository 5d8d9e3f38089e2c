"""Campaigns in real worker processes: whoever runs which trial when, the results are the same bytes."""

from __future__ import annotations

import signal
import subprocess

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from orchestrator import exit_codes
from orchestrator.campaign.directory import CampaignError
from orchestrator.errors import InputError
from orchestrator.evidence.rows import trial_rows
from orchestrator.evidence.sources import load_source
from orchestrator.evidence.table import schema, table
from orchestrator.log.reader import read_log
from orchestrator.run import run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology.load import load_topology
from tests.orchestrator.campaign.conftest import (
    COMMAND,
    PATIENCE_S,
    Home,
    environment,
    facts_of,
    same_bytes,
    table_of,
    wait_until,
    workers_of,
)

GRID = "channel...failure=0.05,0.4"


def test_one_worker_or_two_give_the_same_bytes_in_sorted_rows(home: Home) -> None:
    one, heard = home.sweep("one", 5, GRID, workers=1)
    two, _ = home.sweep("two", 5, GRID, workers=2)
    assert same_bytes(one, two)
    assert sum(heard.finished) == heard.total == 10
    rows = table_of(one)
    keys = list(zip(*(rows[name].to_pylist() for name in ("variant", "trial", "node")), strict=True))
    assert keys == [(v, t, f"e{i}") for v in range(2) for t in range(5) for i in (1, 2, 3)]
    assert set(rows["set.channel...failure"].to_pylist()) == {"0.05", "0.4"}
    assert sorted(file.name for file in one.iterdir()) == [
        *("campaign.json", "results.parquet", "timing.parquet", "topologies", "workers"),
    ]


def test_variants_have_common_random_numbers_and_trials_have_not(home: Home) -> None:
    out, _ = home.sweep("out", 3, "estimators.e1.threshold=9,16", "channel=null")
    rows = table_of(out)
    untouched = rows.filter(pc.equal(rows["node"], "e3"))
    errors = [
        untouched.filter(pc.equal(untouched["variant"], v))["error.position"].to_pylist() for v in (0, 1)
    ]
    assert errors[0][0][:4] == errors[1][0][:4]  # until an attack, which one of them may judge otherwise
    assert errors[0][0] != errors[0][1]


def test_a_trials_row_is_that_of_a_run_of_its_own(home: Home) -> None:
    out, _ = home.sweep("out", 3, GRID)
    topology = load_topology(home.folder / "small.yaml", ["channel...failure=0.4"], trial=2)
    run = run_topology(topology, make_run_directory(home.folder / "run", "r", 7), "inprocess", lambda _: None)
    log = read_log(run.directory / "run.mcap")
    logged = topology_from_experiment(log.topology_json)
    alone = table(trial_rows(logged, log.records()), schema(logged.state_groups))
    rows = table_of(out)
    rows = rows.filter(pc.and_(pc.equal(rows["variant"], 1), pc.equal(rows["trial"], 2)))
    for name in alone.column_names:
        if name != "variant":
            assert rows[name].to_pylist() == alone[name].to_pylist(), name


def test_a_campaign_goes_on_after_everything_was_killed(home: Home) -> None:
    whole, _ = home.sweep("whole", 40, GRID, workers=2)
    arguments = ["sweep", "small.yaml", "--trials", "40", "--set", GRID, "-j", "2", "--out", "killed"]
    killed = home.folder / "killed"
    process = subprocess.Popen(
        [*COMMAND, *arguments], cwd=home.folder, env=environment(), stderr=subprocess.DEVNULL
    )
    try:
        wait_until(lambda: len(list(killed.glob("shards/*.arrows"))) >= 3, "there are shards")
        others = workers_of(killed)
    finally:
        process.kill()
        process.wait(PATIENCE_S)
    assert not (killed / "results.parquet").exists()
    assert others
    wait_until(lambda: not workers_of(killed), "the workers have followed their parent")
    before = len(list(killed.glob("shards/*.arrows")))
    with pytest.raises(InputError, match="unfinished campaign"):
        load_source(killed)
    done = home.command(*arguments)
    assert done.returncode == 0, done.stderr
    assert before
    assert "of them done before" in done.stderr
    assert same_bytes(whole, killed)


def test_more_trials_extend_a_campaign_as_if_they_had_been_asked_for_at_once(home: Home) -> None:
    whole, _ = home.sweep("whole", 6, GRID)
    home.sweep("grown", 2, GRID)
    grown, heard = home.sweep("grown", 6, GRID)
    assert (heard.total, heard.done, sum(heard.finished)) == (12, 4, 8)
    assert same_bytes(whole, grown)
    again, heard = home.sweep("grown", 6, GRID)
    assert (heard.done, heard.finished) == (12, [])
    assert same_bytes(whole, again)
    with pytest.raises(CampaignError, match="holds the results of 6 trials; ask for as many or more"):
        home.sweep("grown", 5, GRID)


def test_a_campaign_that_was_to_be_too_long_is_closed_at_what_its_results_hold(home: Home) -> None:
    whole, _ = home.sweep("whole", 6, GRID)
    out, _ = home.sweep("out", 6, GRID)
    _killed_while_it_goes_on(home, "out", "2000", GRID)
    assert facts_of(out)["trials"] == 2000
    told = home.command("compare", "out", "--by", "variant")
    assert "note: out: 6 of 2000 trials are there; give its 'gauntlet sweep' again to go on" in told.stderr
    assert home.command("report", "out", "--out", "page.html").returncode == 0
    assert "6 of 2000 trials are there" in (home.folder / "page.html").read_text()
    assert load_source(out).provenance["trials"] == 6
    closed, heard = home.sweep("out", 6, GRID)
    assert (heard.done, heard.finished) == (12, [])
    assert facts_of(closed)["trials"] == 6
    assert load_source(closed).unfinished == ()
    assert same_bytes(whole, closed)


def test_one_that_never_had_results_is_closed_early_and_loses_no_trial_that_is_done(home: Home) -> None:
    whole, _ = home.sweep("whole", 5, GRID)
    longer, _ = home.sweep("longer", 12, GRID)
    _killed_while_it_goes_on(home, "out", "2000", GRID)
    out, heard = home.sweep("out", 5, GRID)
    assert heard.done >= 5  # of the first variant, which comes first
    assert same_bytes(whole, out)
    kept = list(out.glob("shards/*.arrows"))
    assert kept
    again, heard = home.sweep("out", 12, GRID)
    assert heard.done > 10
    assert same_bytes(longer, again)


def _killed_while_it_goes_on(home: Home, out: str, trials: str, *overrides: str) -> None:
    """Ask for many trials and kill the sweep after some dozen of them."""
    options = [text for override in overrides for text in ("--set", override)]
    process = subprocess.Popen(
        [*COMMAND, "sweep", "small.yaml", "--trials", trials, "-j", "2", "--out", out, *options],
        cwd=home.folder,
        env=environment(),
        stderr=subprocess.DEVNULL,
    )
    shards = home.folder / out / "shards"
    try:
        wait_until(
            lambda: any(int(own.stem.split("-")[2]) >= 12 for own in shards.glob("*.arrows")),
            "there are shards beyond the first dozen of trials",
        )
    finally:
        process.kill()
        process.wait(PATIENCE_S)
    wait_until(lambda: not workers_of(home.folder / out), "the workers have followed their parent")


def test_trials_may_begin_anywhere(home: Home) -> None:
    whole, _ = home.sweep("whole", 5)
    late, _ = home.sweep("late", 2, first_trial=3)
    rows = table_of(whole)
    assert table_of(late).equals(rows.filter(pc.greater_equal(rows["trial"], 3)))


def test_all_variants_are_checked_before_any_trial_and_all_errors_told_at_once(home: Home) -> None:
    done = home.command(
        *("sweep", "small.yaml", "--trials", "1", "--out", "out"),
        *("--set", "channel...failure=0.1,7", "--set", "estimators.e1.method=kalmann,moody.py:Absent"),
    )
    assert done.returncode == 2
    assert "kalmann" in done.stderr
    assert "Absent" in done.stderr
    assert "failure" in done.stderr
    assert not (home.folder / "out").exists()


def test_what_is_wrong_with_some_variants_only_is_told_with_their_settings(home: Home) -> None:
    told = home.command(
        *("sweep", "small.yaml", "--trials", "1", "--out", "out"),
        *("--set", "channel...failure=0.1,0.2", "--set", "method=secure_distributed,kalman"),
    )
    assert told.returncode == exit_codes.BAD_INPUT
    assert "there is no link e*->e* (with method=kalman)" in told.stderr


def test_ctrl_c_leaves_what_can_go_on_and_no_process(home: Home) -> None:
    arguments = ["sweep", "small.yaml", "--trials", "400", "-j", "2", "--out", "out"]
    process = subprocess.Popen(
        [*COMMAND, *arguments],
        cwd=home.folder,
        env=environment(),
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    out = home.folder / "out"
    try:
        wait_until(lambda: len(list(out.glob("shards/*.arrows"))) >= 2, "there are shards")
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "give the command again with the same --out" in told
    wait_until(lambda: not workers_of(out), "the workers are gone")
    assert list(out.glob("shards/*.arrows"))


def test_two_sweeps_do_not_share_a_directory(home: Home) -> None:
    from orchestrator.campaign.directory import locked

    with locked(home.folder / "out"), pytest.raises(CampaignError, match="another sweep is at work"):
        home.sweep("out", 1)


def test_timings_stand_beside_the_results_one_row_a_trial(home: Home) -> None:
    out, _ = home.sweep("out", 3, GRID)
    timing = pq.read_table(out / "timing.parquet").to_pydict()
    assert list(zip(timing["variant"], timing["trial"], strict=True)) == [
        (v, t) for v in range(2) for t in range(3)
    ]
    assert all(
        0.0 < p50 <= p95 <= wall
        for p50, p95, wall in zip(timing["step_p50_s"], timing["step_p95_s"], timing["wall_s"], strict=True)
    )
    assert set(timing["worker"]) == {"1"}
