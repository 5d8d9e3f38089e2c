from __future__ import annotations

import subprocess
from pathlib import Path

from bus.plan import Plan
from orchestrator.log.provenance import git_commit, provenance


def test_provenance_is_a_function_of_what_is_run(plan: Plan) -> None:
    facts = provenance(plan, "0123abcd")
    assert facts == provenance(plan, "0123abcd")
    assert facts["period_s"] == "0.05"
    assert facts["messages_per_step"] == "25"
    assert all(isinstance(fact, str) for fact in facts.values())


def test_the_versions_of_all_that_computes_are_told(plan: Plan) -> None:
    facts = provenance(plan, "0123abcd")
    for name in ("python", "numpy", "msgspec", "mcap", "zstandard"):
        assert facts[f"version.{name}"][0].isdigit()


def test_the_commit_is_that_of_a_checkout_and_of_no_folder_inside_another_one(tmp_path: Path) -> None:
    def git(*arguments: str) -> str:
        identity = ["-c", "user.name=t", "-c", "user.email=t@t"]
        command = ["git", "-C", str(tmp_path), *identity, *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    git("init", "--quiet")
    assert git_commit(tmp_path) == "none"
    git("commit", "--quiet", "--allow-empty", "--message", "first")
    assert git_commit(tmp_path) == git("rev-parse", "HEAD")
    (tmp_path / "site-packages").mkdir()
    assert git_commit(tmp_path / "site-packages") == "none"


def test_a_folder_outside_of_any_repository_has_no_commit(tmp_path: Path) -> None:
    assert git_commit(tmp_path) == "none"
