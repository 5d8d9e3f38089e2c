"""What tells how to install this project leads to it, and to no other of its name on the public index."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from bus.extras import installing
from tests.docs.test_continuous_integration import FILES

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
TRACKED = subprocess.run(
    ["git", "ls-files", "*.py", "*.md", "*.ipynb", "*.toml", "Makefile"],
    cwd=ROOT,
    capture_output=True,
    text=True,
    check=False,
    timeout=60,
).stdout.split()


@pytest.mark.skipif(not TRACKED, reason="this is no git checkout")
def test_nothing_tells_to_install_by_the_name_on_the_public_index() -> None:
    by_name = re.compile(r"pip[ ]install [^\n]*?(?<![\w/.-])gauntlet\b")
    told = [name for name in TRACKED if by_name.search((ROOT / name).read_text())]
    assert told == []


@pytest.mark.skipif(not TRACKED, reason="this is no git checkout")
def test_every_extra_that_is_told_of_is_one_of_the_project() -> None:
    texts = [(ROOT / name).read_text() for name in TRACKED if not name.startswith("tests/")]
    found = {
        extra
        for text in texts
        for match in re.findall(r"-e '\.\[([\w,]+)\]'|installing\('(\w+)'\)", text)
        for extra in "".join(match).split(",")
    }
    assert {"frames", "report", "lmi", "cluster", "campaign", "draw"} <= found
    assert found <= set(PROJECT["optional-dependencies"])
    assert installing("frames") == "pip install -e '.[frames]' in a checkout of Gauntlet"


def test_the_requirements_of_a_runner_say_where_the_project_comes_from() -> None:
    lines = [line for line in FILES["requirements.txt"].splitlines() if line]
    own, *others = map(Requirement, lines)
    assert own.name == PROJECT["name"]
    assert own.url is not None
    assert own.url.startswith("git+https://")
    assert {other.name for other in others} == {"pytest", "pytest-xdist"}
    assert all(other.url is None and other.specifier for other in others)
