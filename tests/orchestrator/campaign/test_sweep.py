"""Campaigns in real worker processes: whoever runs which trial when, the results are the same bytes."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from orchestrator import exit_codes
from orchestrator.campaign.differences import differences
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
    table_of,
    wait_until,
)

GRID = "channel...failure=0.05,0.4"


def same_bytes(one: Path, other: Path) -> bool:
    return (one / "results.parquet").read_bytes() == (other / "results.parquet").read_bytes()


def workers_of(directory: Path) -> list[int]:
    """The processes that hold a log of the campaign's workers open."""
    found = []
    for process in Path("/proc").iterdir():
        try:
            if process.name.isdigit() and str(directory) in os.readlink(process / "fd" / "1"):
                found.append(int(process.name))
        except OSError:
            continue
    return found


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


@pytest.mark.parametrize(
    ("overrides", "change", "lines"),
    [
        (["channel...failure=0.05,0.3"], {}, ["--set channel...failure: 0.05,0.4 there, 0.05,0.3 here"]),
        ([], {}, ["--set channel...failure: 0.05,0.4 there, not given here"]),
        ([GRID, "steps=8"], {}, ["--set steps: not given there, 8 here"]),
        ([GRID, "name=other"], {}, ["--set name: not given there, other here"]),
        ([GRID], {"seed": 8}, ["--seed: 7 there, 8 here"]),
        ([GRID], {"first_trial": 1}, ["--first-trial: 0 there, 1 here"]),
        ([GRID], {"twins": True}, ["--twin: not given there, given here"]),
        (
            ["steps=8"],
            {"seed": 8},
            [
                "--set channel...failure: 0.05,0.4 there, not given here",
                "--set steps: not given there, 8 here",
                "--seed: 7 there, 8 here",
            ],
        ),
    ],
)
def test_another_campaign_is_refused_with_each_difference_once_and_the_cure(
    home: Home, overrides: list[str], change: dict[str, Any], lines: list[str]
) -> None:
    assert GRID == "channel...failure=0.05,0.4"
    home.sweep("out", 1, GRID)
    with pytest.raises(CampaignError) as refusal:
        home.sweep("out", 2, *overrides, **change)
    first, *found, cure = str(refusal.value).splitlines()
    assert first.startswith(f"{home.folder / 'out'} holds another campaign")
    assert [line.strip() for line in found] == lines
    assert cure.split("; ") == [
        "  to go on with it, give the command as it was there",
        "to begin another one, choose another --out",
    ]


def test_another_topology_is_refused_in_one_line(home: Home) -> None:
    home.sweep("out", 1, GRID)
    text = (home.folder / "small.yaml").read_text()
    (home.folder / "large.yaml").write_text(text.replace("name: small", "name: large"))
    with pytest.raises(CampaignError) as refusal:
        home.sweep("out", 2, GRID, file=home.folder / "large.yaml")
    _, *found, _ = str(refusal.value).splitlines()
    assert found == ["  the topology: small (small.yaml) there, large (large.yaml) here"]


def test_long_values_are_shown_where_they_begin_to_differ() -> None:
    long = ", ".join(f"{number}.25" for number in range(60))
    there, here = ({"overrides": [f"sensors...C=[[{long}, {last}]]"]} for last in ("7.0", "8.0"))
    (found,) = differences(there, here)
    assert len(found.line) < 120
    assert "7.0]]" in found.line.partition(" there, ")[0]
    assert "8.0]]" in found.line.partition(" there, ")[2]


def test_a_changed_topology_or_version_is_refused_with_what_has_changed(home: Home) -> None:
    out, _ = home.sweep("out", 1)
    text = (home.folder / "small.yaml").read_text()
    (home.folder / "small.yaml").write_text(text.replace("std: 0.1", "std: 0.2"))
    with pytest.raises(CampaignError, match=r"the topology: its file.*\n.* put the topology back as it was"):
        home.sweep("out", 2)
    (home.folder / "small.yaml").write_text(text)
    facts = (out / "campaign.json").read_text()
    numpy = facts_of(out)["versions"]["version.numpy"]
    (out / "campaign.json").write_text(facts.replace(f'"{numpy}"', '"0.9"'))
    with pytest.raises(CampaignError, match=r"numpy: 0\.9 there, .*\n.* use the versions that are there"):
        home.sweep("out", 2)


@pytest.mark.parametrize("content", ["[]", "{}", "null", '{"name": "small"}', "{"])
def test_damaged_facts_are_told_by_every_command_with_the_cure(home: Home, content: str) -> None:
    out, _ = home.sweep("out", 1)
    (out / "campaign.json").write_text(content)
    replay = ("replay", "out", "--trial", "0")
    for arguments in (("sweep", "small.yaml", "--trials", "1", "--out", "out"), replay, ("compare", "out")):
        done = home.command(*arguments)
        assert done.returncode == exit_codes.BAD_INPUT
        assert done.stderr.startswith("gauntlet: out is a damaged campaign (")
        assert "give its 'gauntlet sweep' again with another --out" in done.stderr


@pytest.mark.parametrize(
    ("first", "trials", "told"),
    [
        (2**31 - 2, 3, "the last trial would be 2147483648, and the largest is 2147483647"),
        (2**40, 1, "largest"),
    ],
)
def test_trials_beyond_what_results_can_hold_are_refused(
    home: Home, first: int, trials: int, told: str
) -> None:
    with pytest.raises(InputError, match=told):
        home.sweep("out", trials, first_trial=first)
    assert not (home.folder / "out").exists()


def test_the_largest_trial_has_its_row(home: Home) -> None:
    out, _ = home.sweep("out", 1, first_trial=2**31 - 1)
    assert set(table_of(out)["trial"].to_pylist()) == {2**31 - 1}
    with pytest.raises(InputError, match="must be at most 2147483647"):
        load_topology(home.folder / "small.yaml", trial=2**31)


def test_damaged_results_are_told_with_a_cure_that_works(home: Home) -> None:
    out, _ = home.sweep("out", 2)
    results = out / "results.parquet"
    whole = results.read_bytes()
    results.write_bytes(whole[:500])
    with pytest.raises(InputError, match=r"results.parquet is damaged; remove it"):
        home.sweep("out", 2)
    results.unlink()
    home.sweep("out", 2)
    assert results.read_bytes() == whole


def test_a_directory_with_something_else_is_refused(home: Home) -> None:
    (home.folder / "full").mkdir()
    (home.folder / "full" / "thesis.tex").write_text("")
    with pytest.raises(CampaignError, match="holds something else"):
        home.sweep("full", 1)


def test_a_path_that_is_no_directory_is_refused(home: Home) -> None:
    (home.folder / "file").write_text("")
    with pytest.raises(CampaignError, match="file cannot be used"):
        home.sweep("file", 1)


def test_a_full_disk_is_told_and_the_campaign_goes_on_later(home: Home) -> None:
    arguments = ["sweep", "small.yaml", "--trials", "2", "-j", "1", "--out", "out"]
    room = 8192
    done = subprocess.run(
        [*COMMAND, *arguments],
        cwd=home.folder,
        env=environment(),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 3, done.stderr
    assert "arrows cannot be written" in done.stderr
    whole, _ = home.sweep("whole", 2)
    later, _ = home.sweep("out", 2)
    assert same_bytes(whole, later)


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


@pytest.mark.parametrize(("temper", "patience_s"), [("hang while busy", 5.0), ("kill while busy", 60.0)])
def test_trials_that_the_machine_lost_are_tried_anew_and_the_results_are_as_if_none_had_been(
    home: Home, temper: str, patience_s: float
) -> None:
    moody = f"estimators.e1={{method: ./moody.py:Moody, temper: {temper}}}"
    whole, heard = home.sweep("whole", 6, moody, workers=2)
    assert not heard.failed
    (home.folder / "busy").touch()
    _, heard = home.sweep("out", 6, moody, workers=2, trial_timeout_s=patience_s)
    assert 0 < heard.failed < 6
    lost = heard.failed
    _, heard = home.sweep("out", 6, moody, workers=2, trial_timeout_s=patience_s)
    assert (heard.done, sum(heard.finished), heard.failed) == (6 - lost, lost, lost)
    (home.folder / "busy").unlink()
    out, heard = home.sweep("out", 6, moody, workers=2)
    assert (heard.done, sum(heard.finished), heard.failed) == (6 - lost, lost, 0)
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
