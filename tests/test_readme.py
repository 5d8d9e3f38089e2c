"""What the README shows works as it stands."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
COMMAND = [sys.executable, "-m", "orchestrator.command_line.app"]


def call(home: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [*COMMAND, *arguments],
        cwd=home,
        env=environment,
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
    )


def test_the_estimator_of_the_readme_runs_in_the_place_of_another(tmp_path: Path) -> None:
    (source,) = re.findall(r"```python\n# my_filter\.py\n(.*?)```", README, re.DOTALL)
    (tmp_path / "my_filter.py").write_text(source)
    command = next(line for line in README.splitlines() if "my_filter.py:MyFilter" in line)
    _, _, topology, *options = command.split()
    done = call(
        tmp_path, "run", str(ROOT / topology), *options, "--backend", "inprocess", "--set", "expect=null"
    )
    assert done.returncode == 0, done.stderr
    assert "MyFilter" in done.stdout


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(((?!http)[^)#]+)\)", README))))
def test_every_link_of_the_readme_leads_somewhere(target: str) -> None:
    assert (ROOT / target).exists()


@pytest.mark.parametrize("command", sorted(set(re.findall(r"^    gauntlet (\w+)", README, re.MULTILINE))))
def test_every_command_of_the_readme_exists(command: str, tmp_path: Path) -> None:
    assert call(tmp_path, command, "--help").returncode == 0


def test_the_readme_and_the_makefile_name_the_same_two_commands() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert set(re.findall(r"^    make ([a-z-]+)", README, re.MULTILINE)) <= targets
