"""`gauntlet score`: the same verdict from the log alone, whatever is left of it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from mcap.writer import Writer

from tests.orchestrator.command_line.conftest import Command

CUTS = 60


def test_a_score_computed_again_equals_the_runs_byte_for_byte(gauntlet: Command, finished_run: Path) -> None:
    answer = gauntlet("score", finished_run / "run.mcap", "--json")
    assert answer.code == 0
    assert answer.out == (finished_run / "score.json").read_text()


def test_a_score_is_told_to_people_as_after_the_run(gauntlet: Command, finished_run: Path) -> None:
    answer = gauntlet("score", finished_run / "run.mcap")
    assert answer.code == 0
    assert answer.out.startswith("PASSED: ")
    assert not answer.err


def test_a_failed_expectation_is_exit_code_1(gauntlet: Command) -> None:
    gauntlet("run", "small.yaml", "--backend", "inprocess", "--out", "out", "--set", "expect.divergences=3")
    assert gauntlet("score", "out/run.mcap").code == 1


def test_a_log_without_its_directory_is_scored(gauntlet: Command, finished_run: Path, home: Path) -> None:
    shutil.copy(finished_run / "run.mcap", home / "elsewhere.mcap")
    assert gauntlet("score", "elsewhere.mcap", "--json").out == (finished_run / "score.json").read_text()


def test_a_log_cut_off_anywhere_is_scored_as_far_as_it_goes_or_refused_in_one_sentence(
    gauntlet: Command, finished_run: Path, home: Path
) -> None:
    whole = (finished_run / "run.mcap").read_bytes()
    cuts = sorted(
        {*range(0, len(whole), len(whole) // CUTS), *range(20), *range(len(whole) - 20, len(whole))}
    )
    steps = []
    for cut in cuts:
        (home / "cut.mcap").write_bytes(whole[:cut])
        answer = gauntlet("score", "cut.mcap", "--json")
        assert "Traceback" not in answer.err, cut
        if answer.code == 2:
            assert not answer.out, cut
            assert answer.err.startswith("gauntlet: cut.mcap "), cut
            assert not steps, f"cut at {cut}: more bytes cannot tell less"
        else:
            score = json.loads(answer.out)
            complete = score["complete"]
            assert (answer.code, score["passed"]) == ((0, True) if complete else (1, False)), cut
            steps.append(score["steps_recorded"])
            assert {node["steps_scored"] for node in score["nodes"]} == {score["steps_recorded"]}, cut
            assert complete == (score["steps_recorded"] == score["steps"]), cut
    assert steps == sorted(steps)
    assert steps[0] == 0
    assert steps[-1] == 24
    assert {0, 10, 20, 24} == set(steps), "chunks of ten steps"


def test_a_truncated_log_is_marked_for_people(gauntlet: Command, cut_off: tuple[Path, int]) -> None:
    log, steps = cut_off
    answer = gauntlet("score", log)
    assert answer.code == 1
    missing = 3 * (24 - steps)
    assert answer.out.startswith(f"INCOMPLETE: {steps} of 24 steps recorded, {missing} estimates missing; as")


def another_programs_log(path: Path) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("small.yaml", "small.yaml is not an MCAP file; give a log that `gauntlet run` wrote"),
        ("nowhere.mcap", "nowhere.mcap cannot be read: No such file or directory"),
        (".", ". holds no run.mcap; give a log, or the directory of a run"),
        ("foreign.mcap", "it is not a log of gauntlet's"),
    ],
)
@pytest.mark.parametrize("command", [("score",), ("log", "info"), ("log", "recover")], ids=" ".join)
def test_what_is_no_log_of_ours_is_refused_in_one_sentence(
    gauntlet: Command, home: Path, command: tuple[str, ...], name: str, complaint: str
) -> None:
    another_programs_log(home / "foreign.mcap")
    answer = gauntlet(*command, name)
    assert answer.code == 2
    assert complaint in answer.err
    assert answer.err.startswith("gauntlet: ")
    assert answer.err.count("\n") == 1
    assert not answer.out
