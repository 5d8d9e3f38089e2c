"""Small topologies and estimators, good and bad, in a folder of their own."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, fromstring

import pytest

from orchestrator.testing.again import Source
from orchestrator.testing.claims import Trial
from orchestrator.testing.trials import Trials, run_trials
from orchestrator.topology.load import load_topology

Make = Callable[..., Trials]

CALM = """
name: calm
period_s: 0.1
steps: 40
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
sensors:
  s1..s2: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}
estimators:
  e1..e2: {method: kalman}
expect:
  divergences: 0
  rmse.position: {node: [e1, e2], at_most: 0.2}
"""

ATTACKED = """
name: attacked
extends: calm.yaml
attacks:
  - {bias: {value: 5.0}, on: s1->e1, steps: [20, 25]}
estimators:
  e1..e2: {threshold: 20.0, on_alarm: reject}
"""

RAISING = '''
"""An estimator that gives up."""

import numpy as np

from nodes.contract import Belief


class Raising:
    """Raises in step 7."""

    rounds = 0

    def __init__(self, setting):
        self.size = setting.plant.initial_mean.size

    def correct(self, step, packets):
        if step == 7:
            raise ArithmeticError("out of \\x1b[31mideas\\x00")

    def exchange(self, step, round_, packets): ...

    def estimate(self, step):
        return Belief(state=np.zeros(self.size), covariance=np.eye(self.size))
'''

OVERCONFIDENT = '''
"""A Kalman filter that believes in a covariance that is too small."""

from nodes.contract import Belief
from nodes.estimators.kalman import Kalman


class Overconfident(Kalman):
    """Divides its covariance by a factor."""

    def __init__(self, setting, *, factor: float = 4.0):
        super().__init__(setting)
        self.factor = factor

    def estimate(self, step):
        belief = super().estimate(step)
        return Belief(state=belief.state, covariance=belief.covariance / self.factor)
'''


ROOT = Path(__file__).parents[3]
ATTRIBUTES = {
    "testsuites": {"name", "time", "tests", "failures", "errors"},
    "testsuite": {"name", "tests", "failures", "errors", "time", "skipped"},
    "testcase": {"name", "classname", "time"},
    "skipped": {"message"},
    "error": {"message", "type"},
    "failure": {"message", "type"},
}
CHILDREN = {
    "testsuites": {"testsuite"},
    "testsuite": {"testcase"},
    "testcase": {"skipped", "error", "failure"},
}


def check_junit(document: bytes) -> Element:
    """Return the root of a document that has the form that servers read, and whose counts are right."""
    root = fromstring(document)
    assert root.tag == "testsuites"
    for element in root.iter():
        assert set(element.attrib) == ATTRIBUTES[element.tag]
        assert {child.tag for child in element} <= CHILDREN.get(element.tag, set())
    for group in (root, *root):
        assert int(group.attrib["tests"]) == len(list(group.iter("testcase")))
        assert int(group.attrib["failures"]) == len(list(group.iter("failure")))
        assert int(group.attrib["errors"]) == len(list(group.iter("error")))
        times = [float(case.attrib["time"]) for case in group.iter("testcase")]
        assert float(group.attrib["time"]) == pytest.approx(sum(times), abs=1e-3 * (len(times) + 1))
    return root


def installed_plugin(site: Path) -> Path:
    """Make a folder that declares the entry points of Gauntlet as an installation does; return it."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]["pytest11"]
    installed = site / "gauntlet_as_installed-1.dist-info"
    installed.mkdir(parents=True)
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: gauntlet-as-installed\nVersion: 1\n")
    points = "".join(f"{name} = {target}\n" for name, target in declared.items())
    (installed / "entry_points.txt").write_text(f"[pytest11]\n{points}")
    return site


@pytest.fixture
def calm(tmp_path: Path) -> Path:
    """A folder with a calm topology, one under attack, and estimators of a user's own."""
    (tmp_path / "calm.yaml").write_text(CALM)
    (tmp_path / "attacked.yaml").write_text(ATTACKED)
    (tmp_path / "raising.py").write_text(RAISING)
    (tmp_path / "overconfident.py").write_text(OVERCONFIDENT)
    return tmp_path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trials")
    for name, text in {
        "calm.yaml": CALM,
        "attacked.yaml": ATTACKED,
        "overconfident.py": OVERCONFIDENT,
    }.items():
        (folder / name).write_text(text)
    return folder


@pytest.fixture(scope="module")
def make(folder: Path) -> Make:
    def make(name: str, seeds: range, *overrides: str, backend: str = "inprocess") -> Trials:
        loaded = load_topology(folder / name, overrides, directory=folder)
        return run_trials(loaded, seeds, folder / "logs", backend, overrides, folder)

    return make


@pytest.fixture(scope="module")
def calm_trials(make: Make) -> Trials:
    return make("calm.yaml", range(10))


def of(trials: Trials, chosen: Sequence[Trial], *overrides: str) -> Trials:
    """Return some of the trials, or others in their place, as trials of the same topology."""
    file, folder = trials.topology.path, trials.topology.path.parent
    source = Source(file, overrides, folder, "inprocess", 0, folder / "logs", "logs")
    return Trials(trials.topology, chosen, source)


def log_in(failure: pytest.ExceptionInfo[AssertionError]) -> Path:
    """Return the log that a failed assertion points to."""
    (path,) = re.findall(r"log of seed \d+: (\S+)", str(failure.value))
    return Path(path)
