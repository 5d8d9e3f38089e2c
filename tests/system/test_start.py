"""What is started before the topology is known is no process of a run, and nothing of it is left."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.system.conftest import PATIENCE_S, SMALL, Gauntlet


def processes_of_session(session: int) -> list[str]:
    """The command lines of a session's processes."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if int((entry / "stat").read_text().rpartition(")")[2].split()[3]) == session:
                found.append((entry / "cmdline").read_text())
        except (OSError, ValueError, IndexError):
            continue
    return found


@pytest.mark.parametrize(
    ("text", "arguments", "code"),
    [
        (SMALL.replace("steps:", "stepz:"), (), 2),
        (SMALL, ("--out", "topology.yaml"), 2),
        (SMALL + "process: {backend: inprocess}\n", (), 0),
    ],
    ids=["bad topology", "bad directory", "one process"],
)
def test_a_run_that_needs_no_process_leaves_none(
    gauntlet: Gauntlet, text: str, arguments: tuple[str, ...], code: int
) -> None:
    command = gauntlet.command("run", gauntlet.write(text), *arguments)
    process = subprocess.Popen(
        command,
        cwd=gauntlet.home,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    assert process.wait(PATIENCE_S) == code
    assert processes_of_session(process.pid) == []
