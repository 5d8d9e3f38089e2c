"""What docs/handoff.md shows works, and what it lists is there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from orchestrator.handoff import load
from orchestrator.run import run_topology
from orchestrator.topology.load import load_topology

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "handoff.md").read_text()
TOPOLOGY = """
period_s: 0.1
steps: 20
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
sensors:
  s1: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}
estimators:
  e1: {method: kalman, sensors: [s1], threshold: 20}
channel:
  s*->e1: {bernoulli: {loss: 0.1}}
attacks:
  - {bias: {value: 5.0}, on: s1->e1, steps: [10, 12]}
"""


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the run and the campaign that the page speaks of."""
    home = tmp_path_factory.mktemp("handoff-docs")
    (home / "case.yaml").write_text(TOPOLOGY)
    (home / "runs" / "two-filters").mkdir(parents=True)
    topology = load_topology(home / "case.yaml")
    run_topology(topology, home / "runs" / "two-filters", "inprocess", lambda recorded: None)
    losses = "channel.s*->e1.bernoulli.loss=0.1,0.3"
    command = f"sweep case.yaml --trials 2 -j 1 --set {losses} --out runs/losses"
    done = subprocess.run(
        [sys.executable, "-m", "orchestrator.command_line.app", *command.split()],
        cwd=home,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return home


def test_the_examples_of_the_page_run(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home)
    names: dict[str, Any] = {}
    for example in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        exec(example, names)
    assert names["run"].kind == "run"
    assert names["campaign"].arrays.sizes["variant"] == 2


def test_the_page_lists_every_frame_with_its_columns(home: Path) -> None:
    run = load(home / "runs" / "two-filters")
    rows = dict(re.findall(r"^\| `(\w+)` \| an? [^|]+\| (.*) \|$", PAGE, re.MULTILINE))
    assert len(rows) == 10
    for frame, told in rows.items():
        columns = getattr(run, frame).columns
        named = set(re.findall(r"`(\w+)`", told)) - {"tx", "rx", "metric"}
        assert named <= set(columns), frame
        fixed = [name for name in columns if not re.search("position|velocity|acceleration|^bound_", name)]
        assert frame == "results" or set(fixed) <= named, frame


def test_the_page_lists_every_array_with_its_dimensions(home: Path) -> None:
    arrays = load(home / "runs" / "two-filters").arrays
    table = PAGE.split("| variable | dimensions |")[1].split("\n\n")[0]
    told = {
        name: tuple(re.findall(r"`(\w+)`", dimensions))
        for names, dimensions in re.findall(r"^\| (.*?) \| (.*) \|$", table, re.MULTILINE)
        for name in re.findall(r"`(\w+)`", names)
    }
    assert told == {str(name): array.dims for name, array in arrays.data_vars.items()}


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.stem)
def test_every_link_of_a_page_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(((?!http)[^)#]+)[^)]*\)", page.read_text()):
        assert (page.parent / target).exists(), target
