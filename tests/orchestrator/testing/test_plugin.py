"""The pytest plugin, in whole pytest runs of a user's project, each in a process of its own."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from orchestrator.log.reader import read_log
from tests.orchestrator.testing.conftest import ATTACKED, CALM, OVERCONFIDENT, RAISING, installed_plugin

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parents[3]
PLUGIN = ("-p", "no:gauntlet", "-p", "orchestrator.testing.plugin", "--gauntlet-logs", "kept")
GOOD = """
def test_good(topology):
    trials = topology("calm.yaml", seeds=range(12))
    assert trials.seeds == tuple(range(12))
    assert [score.seed for score in trials.scores] == list(range(12))
    trials.assert_passes()
    trials.assert_consistent(false_alarm=1e-4)
    trials.assert_rmse("position", at_most=0.15, node="e1..e2", each_seed=True)
    trials.assert_metric("packets.lost", equals=0)
    topology("attacked.yaml", seeds=range(12)).assert_detects_within(0, share=0.9, link="s1->e1")

def test_shared(topology):
    assert topology("calm.yaml", seeds=[1, 2]) is topology("calm.yaml", seeds=range(1, 3))
    assert topology("calm.yaml").seeds == (0,)
    assert topology("calm.yaml").scores != topology("calm.yaml", overrides=["steps=20"]).scores
"""
ASKED = """
import pytest

@pytest.fixture(scope="module")
def many(topology):
    return topology("calm.yaml", seeds=range(2))

def test_a_fixture_of_the_module_runs_trials(many, topology):
    assert many is topology("calm.yaml", seeds=[0, 1])

@pytest.mark.parametrize(("asked", "words"), [
    ({"seeds": 5}, "seeds=5 is an int"),
    ({"seeds": [1.5]}, "seeds holds 1.5"),
    ({"seeds": [2**70]}, "too large"),
    ({"overrides": "steps=50"}, "overrides='steps=50' is a str"),
])
def test_what_cannot_be_meant_is_refused_before_anything_is_read(topology, asked, words):
    with pytest.raises((TypeError, ValueError), match=words):
        topology("missing.yaml", **asked)

def test_no_log(topology):
    topology("calm.yaml", seeds=range(3)).assert_rmse("position", at_most=0.001)
"""
BAD = """
def test_overconfident(topology):
    overrides = ["estimators.e2.method=./overconfident.py:Overconfident"]
    topology("calm.yaml", seeds=range(5, 25), overrides=overrides).assert_consistent()

def test_raising(topology):
    topology("calm.yaml", seeds=[4], overrides=["estimators.e2.method=./raising.py:Raising"])
"""


def write_project(home: Path, **tests: str) -> None:
    """Write topologies and estimators, and tests beside them."""
    files = {"calm.yaml": CALM, "attacked.yaml": ATTACKED, "raising.py": RAISING}
    files |= {"overconfident.py": OVERCONFIDENT, **{f"test_{name}.py": text for name, text in tests.items()}}
    (home / "checks").mkdir()
    for name, text in files.items():
        (home / "checks" / name).write_text(text)


def test_good_filters_pass_and_bad_ones_fail_with_numbers_seeds_and_logs(pytester: pytest.Pytester) -> None:
    write_project(pytester.path, good=GOOD, bad=BAD)
    result = pytester.runpytest_subprocess(*PLUGIN, "-p", "xdist", "-n", "2", timeout=90)
    result.assert_outcomes(passed=2, failed=2)
    text = result.stdout.str()
    assert re.search(r"calm \(\S*checks/calm.yaml\), 20 seeds, 5 to 24:", text)
    (ratio,) = set(re.findall(r"ANEES of e2 over its degrees of freedom is (\S+) at step", text))
    assert 2.5 < float(ratio) < 9.0
    assert "false-alarm rate of this assertion: 0.001" in text
    command = r"again, in \S+checks: gauntlet run calm.yaml --seed (\d+) --set (.*) --backend inprocess"
    (again,) = set(re.findall(command, text))
    assert again[1] == "estimators.e2.method=./overconfident.py:Overconfident"
    (log,) = set(re.findall(rf"log of seed {again[0]}: (\S+)", text))
    assert Path(log).is_relative_to(pytester.path / "kept")
    assert read_log(Path(log)).provenance["seed"] == again[0]
    assert re.search(r"TrialError: calm \(\S+\), seed 4: e2 failed in step 7: ArithmeticError", text)
    (partial,) = set(re.findall(r"log up to there: (\S+run\.mcap)", text))
    assert {payload.step for payload in read_log(Path(partial)).payloads()} >= set(range(7))


def test_what_is_asked_is_checked_and_logs_that_cannot_be_written_hide_no_assertion(
    pytester: pytest.Pytester,
) -> None:
    write_project(pytester.path, asked=ASKED)
    pytester.path.joinpath("file").touch()
    result = pytester.runpytest_subprocess(*PLUGIN[:-1], "file/kept", timeout=90)
    result.assert_outcomes(passed=5, failed=1)
    text = result.stdout.str()
    assert "above it alone, 3 of 3" in text
    assert re.search(r"no log of seed \d: \S+: Not a directory; choose another --gauntlet-logs", text)


def test_installing_gauntlet_gives_pytest_the_fixture_and_costs_other_projects_nothing(
    pytester: pytest.Pytester,
) -> None:
    site = installed_plugin(pytester.path / "site")
    pytester.makepyfile(
        """
        import sys

        def test_nothing_heavy_is_loaded(pytestconfig):
            assert pytestconfig.pluginmanager.get_plugin("gauntlet").__name__ == "orchestrator.testing.plugin"
            heavy = {"numpy", "pydantic", "msgspec", "mcap", "zenoh", "networkx", "orchestrator.run"}
            assert not heavy & set(sys.modules)
        """
    )
    environment = {"PATH": "/usr/bin:/bin", "PYTHONPATH": f"{site}:{ROOT}"}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:hypothesispytest"],
        cwd=pytester.path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
