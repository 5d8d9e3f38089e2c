"""The project in docs/continuous-integration.md: its workflow passes, and fails when its estimator is bad."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from orchestrator.testing.trials import run_trials
from orchestrator.topology.load import load_topology
from tests.orchestrator.testing.conftest import check_junit, installed_plugin

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "continuous-integration.md").read_text()
FILES = dict(re.findall(r"```(?:python|yaml|text)\n# (\S+)\n(.*?)```", PAGE, re.DOTALL))
WORKFLOW = YAML(typ="safe", pure=True).load(FILES[".github/workflows/estimator.yml"])


def _commands() -> dict[str, str]:
    steps: list[dict[str, Any]] = WORKFLOW["jobs"]["test"]["steps"]
    return {step["name"]: step["run"] for step in steps if "run" in step}


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """The project as the page has it."""
    home = tmp_path / "project"
    for name, text in FILES.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_text(text)
    return home


@pytest.fixture
def run(project: Path, tmp_path: Path) -> Any:
    """Run a command of the workflow as its server would, with what `pip install` gives in place."""
    tools = tmp_path / "bin"
    tools.mkdir()
    for name, module in {"gauntlet": "orchestrator.command_line.app", "python": ""}.items():
        call = f"-m {module} " if module else ""
        (tools / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {call}"$@"\n')
        (tools / name).chmod(0o755)
    site = installed_plugin(tmp_path / "site")
    environment = {
        "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": f"{site}{os.pathsep}{ROOT}",
        "HOME": str(tmp_path),
    }

    def call(command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["bash", "-e", "-c", command],
            cwd=project,
            env=environment,
            capture_output=True,
            text=True,
            timeout=90,
            check=False,
        )

    return call


def test_the_page_shows_a_whole_project() -> None:
    assert list(FILES) == [
        "gated_filter.py",
        "topologies/lossy.yaml",
        "topologies/falsified.yaml",
        "tests/test_gated_filter.py",
        "requirements.txt",
        ".github/workflows/estimator.yml",
    ]
    install, *others = _commands().values()
    assert install == "pip install -r requirements.txt"
    assert len(others) == 3


@pytest.mark.timeout(240)
def test_the_workflow_passes_and_writes_its_reports(run: Any, project: Path) -> None:
    install, *commands = _commands().values()
    assert install.startswith("pip install")
    printed = ""
    for command in commands:
        done = run(command)
        assert done.returncode == 0, done.stdout + done.stderr
        printed += done.stdout
    (shown,) = re.findall(r"\$ gauntlet test topologies\n(.*?)```", PAGE, re.DOTALL)
    timeless = re.compile(r" \([\d.]+ s.*?\)")
    assert timeless.sub("", shown) in timeless.sub("", printed)
    assert re.search(r"3 passed", printed)
    suites = check_junit((project / "reports" / "topologies.xml").read_bytes())
    assert [len(list(suite)) for suite in suites] == [4, 3]
    assert (project / "reports" / "trials.xml").exists()


@pytest.mark.timeout(240)
def test_an_estimator_that_got_worse_turns_the_workflow_red(run: Any, project: Path) -> None:
    source = project / "gated_filter.py"
    worse = source.read_text().replace("+ self.plant.Q", "+ 0.01 * self.plant.Q")
    assert worse != source.read_text()
    source.write_text(worse)
    _, _, single, many = _commands().values()
    failed = run(single)
    assert failed.returncode == 1, failed.stdout + failed.stderr
    assert "✗ topologies/lossy.yaml" in failed.stdout
    failed = run(many.replace("-n 2", "-k how_well"))
    assert failed.returncode == 1, failed.stdout + failed.stderr
    assert "ANEES of e1" in failed.stdout
    (log,) = re.findall(r"log of seed \d+: (\S+)", failed.stdout)
    assert Path(log).is_relative_to(project / "reports" / "logs")
    assert Path(log).exists()


def test_the_failure_that_the_page_shows_is_what_is_told(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(project)
    overrides, here = ["estimators.e1.threshold=1e9"], project / "tests"
    loaded = load_topology(Path("topologies/falsified.yaml"), overrides)
    trials = run_trials(loaded, range(20), Path("reports/logs"), overrides=overrides, directory=here)
    with pytest.raises(AssertionError) as told:
        trials.assert_rmse("position", at_most=0.25)
    (shown,) = re.findall(r"```\nAssertionError: (.*?)```", PAGE, re.DOTALL)
    assert str(told.value).replace(f"{project}/", "") == shown.rstrip()
