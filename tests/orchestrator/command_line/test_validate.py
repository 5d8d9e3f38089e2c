"""`gauntlet validate`: every mistake of every file, and what a valid one describes."""

from __future__ import annotations

from pathlib import Path

from tests.orchestrator.command_line.conftest import ROOT, SMALL, Command

CASE_B = ROOT / "topologies" / "ding2021" / "case_b.yaml"


def test_a_valid_topology_is_summed_up(gauntlet: Command) -> None:
    answer = gauntlet("validate", "small.yaml")
    assert answer.code == 0
    assert not answer.err
    assert answer.out.splitlines()[:3] == [
        "small.yaml: small is valid",
        "  24 steps of 0.1 s, seed 7, 9 processes, 1 expectation",
        "  3 sensors; estimators: 3 SecureDistributed; 9 links",
    ]
    assert "  stage bias@s2->e2 on 1 link" in answer.out


def test_one_bad_file_among_several_is_told_and_the_others_are_checked(gauntlet: Command, home: Path) -> None:
    text = SMALL.replace("steps: 24", "stepz: 24").replace("failure: 0.2", "failure: 2")
    (home / "bad.yaml").write_text(text)
    answer = gauntlet("validate", "bad.yaml", "small.yaml", "nowhere.yaml")
    assert answer.code == 2
    assert "small.yaml: small is valid" in answer.out
    for place in ("bad.yaml:5: ", "bad.yaml:13: ", "nowhere.yaml: "):
        assert place in answer.err


def test_a_mistake_in_a_base_is_told_once_for_all_its_heirs(gauntlet: Command, home: Path) -> None:
    (home / "_base.yaml").write_text(SMALL.replace("steps: 24", "steps: none"))
    for name in ("a", "b"):
        (home / f"{name}.yaml").write_text("extends: _base.yaml\nseed: 3\n")
    answer = gauntlet("validate", "_base.yaml", "a.yaml", "b.yaml")
    assert answer.code == 2
    assert answer.err.count("_base.yaml:5: steps: ") == 1


def test_json_tells_the_same_to_programs(gauntlet: Command, home: Path) -> None:
    (home / "bad.yaml").write_text(SMALL.replace("steps: 24", "stepz: 24"))
    (home / "_base.yaml").write_text("period_s: 0.1\n")
    answer = gauntlet("validate", "small.yaml", "bad.yaml", "_base.yaml", "--json")
    assert answer.code == 2
    assert not answer.err
    facts = answer.json()
    assert facts["valid"] is False
    assert [topology["file"] for topology in facts["topologies"]] == ["small.yaml"]
    assert facts["topologies"][0]["links"] == 9
    assert facts["bases"] == [{"file": "_base.yaml", "warnings": []}]
    assert {"bad.yaml"} == {problem["file"] for problem in facts["problems"]}
    assert 5 in {problem["line"] for problem in facts["problems"]}


def test_overrides_and_seed_are_checked_too(gauntlet: Command) -> None:
    answer = gauntlet("validate", "small.yaml", "--set", "steps=20", "--seed", "3", "--json")
    (summary,) = answer.json()["topologies"]
    assert (summary["steps"], summary["seed"]) == (20, 3)
    assert gauntlet("validate", "small.yaml", "--set", "steps=0").code == 2


def test_a_base_is_checked_for_what_it_says_not_for_what_it_leaves_out(gauntlet: Command, home: Path) -> None:
    (home / "_base.yaml").write_text("period_s: 0.1\n")
    sound = gauntlet("validate", "_base.yaml")
    assert sound.code == 0
    assert sound.out.startswith("_base.yaml: is a base, and sound")
    (home / "_base.yaml").write_text("period_z: 0.1\n")
    faulty = gauntlet("validate", "_base.yaml")
    assert faulty.code == 2
    assert "did you mean 'period_s'?" in faulty.err
    assert not faulty.out


def test_the_sufficient_condition_of_ding_is_computed_and_does_not_hold_for_its_own_example(
    gauntlet: Command,
) -> None:
    answer = gauntlet("validate", CASE_B)
    assert "xi_p = 2.445, xi_q = 2.447" in answer.out
    assert "the condition fails" in answer.out
    assert "with every packet arriving: the bound Pi settles" in answer.out
