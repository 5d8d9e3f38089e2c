"""Every file of the tutorial is written and every command run, in the order of the page."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text()

pytestmark = pytest.mark.timeout(400)


def blocks() -> Iterator[tuple[str, str]]:
    """Yield (language, text) of each fenced block."""
    yield from re.findall(r"^```(\w+)\n(.*?)^```", TUTORIAL, re.DOTALL | re.MULTILINE)


def test_the_set_up_of_the_tutorial_is_that_of_the_readme() -> None:
    (set_up,) = (text for language, text in blocks() if language == "bash")
    assert "make run" in set_up
    assert "    make run" in (ROOT / "README.md").read_text()


def save(home: Path, text: str) -> None:
    """Write a file that names itself in its first line, or add to it."""
    name, _, continued = text.partition("\n")[0].removeprefix("# ").partition(", ")
    assert name, text
    path = home / name
    body = text.partition("\n")[2]
    path.write_text(f"{path.read_text()}\n\n{body}" if continued else text)


def call(home: Path, command: str) -> subprocess.CompletedProcess[str]:
    gauntlet = f'gauntlet() {{ "{sys.executable}" -m orchestrator.command_line.app "$@"; }}; '
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100"}
    return subprocess.run(
        ["bash", "-c", gauntlet + command],
        cwd=home,
        env=environment,
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )


def follow(home: Path, session: str) -> None:
    """Run each command of a session: its exit code must be as told, and its output hold each line shown."""
    for part in re.split(r"^\$ ", session, flags=re.MULTILINE)[1:]:
        line, _, shown = part.partition("\n")
        command, _, remark = line.partition("  # exit code ")
        done = call(home, command)
        assert done.returncode == int(remark or 0), done.stdout + done.stderr
        printed = (done.stdout + done.stderr).splitlines()
        for expected in shown.splitlines():
            assert any(shows(expected, one) for one in printed), (
                f"{command} no longer prints\n{expected}\nbut\n" + "\n".join(printed)
            )


def shows(expected: str, printed: str) -> bool:
    """Whether a line holds what is expected: blanks count once, and ``...`` stands for anything."""
    pattern = r"\s+".join(map(re.escape, expected.split())).replace(r"\.\.\.", ".*")
    return re.search(pattern, printed) is not None


def test_every_command_of_the_tutorial_does_what_the_page_says(tmp_path: Path) -> None:
    commands = 0
    for language, text in blocks():
        if language in ("yaml", "python"):
            save(tmp_path, text)
        elif language == "console":
            follow(tmp_path, text)
            commands += text.count("$ ")
    assert commands >= 10
