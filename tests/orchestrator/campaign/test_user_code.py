"""Code of a user's own that changes between two sweeps: it is found wherever it lies, and named."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from orchestrator import exit_codes
from orchestrator.campaign.user_code import code_of
from orchestrator.topology.load import load_topology
from tests.orchestrator.campaign.conftest import Home, facts_of

FILTER = """
import numpy as np
from nodes.contract import Belief
{imports}

class Still:
    rounds = 0

    def __init__(self, setting):
        self.mean = setting.plant.initial_mean + {gain}

    def correct(self, step, packets): ...

    def exchange(self, step, round_, packets): ...

    def estimate(self, step):
        return Belief(state=self.mean, covariance=np.eye(self.mean.size))
"""
IN_PACKAGE = "estimators.e1.method=mypkg.filters:Still"
IN_FILE = "estimators.e1.method=./alone.py:Still"


@pytest.fixture
def coded(home: Home) -> Home:
    """A package of a user's own, and a file that imports a module beside it."""
    package = home.folder / "mypkg"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "tuning.py").write_text("GAIN = 0.5\n")
    (package / "unused.py").write_text("")
    (package / "filters.py").write_text(FILTER.format(imports="from .tuning import GAIN", gain="GAIN"))
    (home.folder / "beside.py").write_text("GAIN = 0.5\n")
    (home.folder / "alone.py").write_text(FILTER.format(imports="import beside", gain="beside.GAIN"))
    return home


def swept(home: Home, trials: int, override: str) -> tuple[int, str]:
    done = home.command("sweep", "small.yaml", "--trials", str(trials), "--set", override, "--out", "out")
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("override", "names"),
    [
        (
            IN_PACKAGE,
            {
                "mypkg/filters.py": "mypkg.filters",
                "mypkg/tuning.py": "mypkg.tuning",
                "mypkg/__init__.py": "mypkg",
            },
        ),
        (IN_FILE, {"beside.py": "beside", "alone.py": "alone.py"}),
    ],
)
def test_code_that_was_changed_is_refused_by_name_and_goes_on_when_it_is_put_back(
    coded: Home, override: str, names: dict[str, str]
) -> None:
    assert swept(coded, 1, override)[0] == exit_codes.PASSED
    for file, name in names.items():
        place = coded.folder / file
        before = place.read_text()
        place.write_text(before + "# changed\n")
        code, told = swept(coded, 2, override)
        assert code == exit_codes.BAD_INPUT
        assert f"  the code of {name} was changed\n" in told
        assert "put the code back as it was" in told
        assert "the topology" not in told
        place.write_text(before)
    assert swept(coded, 2, override)[0] == exit_codes.PASSED


def test_only_code_that_is_run_counts_and_nothing_that_has_a_version(coded: Home) -> None:
    assert swept(coded, 1, IN_PACKAGE)[0] == exit_codes.PASSED
    assert sorted(facts_of(coded.folder / "out")["code"]) == ["mypkg", "mypkg.filters", "mypkg.tuning"]
    (coded.folder / "mypkg" / "unused.py").write_text("VALUE = 1\n")
    assert swept(coded, 2, IN_PACKAGE)[0] == exit_codes.PASSED
    plain = load_topology(coded.folder / "small.yaml")
    assert code_of([plain.plan]) == {}


def test_an_installed_distribution_has_its_version(home: Home, monkeypatch: pytest.MonkeyPatch) -> None:
    place = home.folder / "site-packages"
    (place / "sold").mkdir(parents=True)
    (place / "sold" / "__init__.py").write_text(FILTER.format(imports="", gain="1.0"))
    monkeypatch.syspath_prepend(place)
    for version in ("1.0", "1.1"):
        noted = place / "sold-0.dist-info"
        noted.mkdir(exist_ok=True)
        (noted / "METADATA").write_text(f"Metadata-Version: 2.1\nName: sold\nVersion: {version}\n")
        topology = load_topology(home.folder / "small.yaml", ["estimators.e1.method=sold:Still"])
        assert code_of([topology.plan]) == {"sold": version}


def test_two_files_of_one_name_are_both_known(coded: Home) -> None:
    (coded.folder / "alone.py").write_text(FILTER.format(imports="", gain="0.5"))
    other = coded.folder / "other"
    other.mkdir()
    (other / "alone.py").write_text((coded.folder / "alone.py").read_text() + "# another\n")
    overrides = ["channel=null", IN_FILE, "estimators.e2.method=./other/alone.py:Still"]
    known = code_of([load_topology(coded.folder / "small.yaml", overrides).plan])
    assert len(set(known["alone.py"].split())) == 2


@pytest.mark.parametrize(
    ("override", "file", "name"),
    [(IN_PACKAGE, "mypkg/tuning.py", "mypkg.tuning"), (IN_FILE, "alone.py", "alone.py")],
)
def test_a_replay_with_changed_code_says_so_to_people_and_programs_and_fails(
    coded: Home, override: str, file: str, name: str
) -> None:
    swept(coded, 1, override)
    place = coded.folder / file
    place.write_text(place.read_text() + "GAIN = 0.25\n")
    replay = ("replay", "out", "--trial", "0", "--backend", "inprocess")
    done = coded.command(*replay)
    assert done.returncode == exit_codes.BAD_INPUT
    assert f"the code of {name} changed since the campaign was made" in done.stderr
    assert "machine" not in done.stderr
    told = json.loads(coded.command(*replay, "--json").stdout)["campaign"]
    assert told["changed"] == [f"the code of {name}"]
    assert told["same_score"] is (file == "alone.py")


def test_a_replay_of_a_changed_topology_says_so(home: Home) -> None:
    out, _ = home.sweep("out", 1)
    variant: Path = out / "topologies" / "variant-000.yaml"
    text = variant.read_text()
    assert "std: 0.1" in text
    variant.write_text(text.replace("std: 0.1", "std: 0.2"))
    done = home.command("replay", "out", "--trial", "0", "--backend", "inprocess")
    assert done.returncode == exit_codes.BAD_INPUT
    assert "the topology or a class in it changed since the campaign was made" in done.stderr
