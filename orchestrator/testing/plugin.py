"""The pytest plugin: the fixture `topology` runs trials of a topology file.

It is loaded with every pytest run of an environment that has Gauntlet, so it imports nothing until a test
asks for the fixture.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import pytest

if TYPE_CHECKING:
    from orchestrator.testing.trials import Trials


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that says where logs go."""
    parser.getgroup("gauntlet").addoption(
        "--gauntlet-logs",
        metavar="DIR",
        help="where the logs of failing seeds are kept; by default in pytest's temporary folder",
    )


@pytest.fixture(scope="session")
def _gauntlet_trials() -> dict[Any, Any]:
    """Trials that were run in this session: tests that ask for the same ones share them."""
    return {}


@pytest.fixture(scope="session")
def _gauntlet_logs(pytestconfig: pytest.Config, tmp_path_factory: pytest.TempPathFactory) -> Path:
    chosen = pytestconfig.getoption("--gauntlet-logs")
    if chosen is None:
        return tmp_path_factory.mktemp("gauntlet-logs")
    return Path(pytestconfig.invocation_params.dir, chosen)


@pytest.fixture(scope="module")
def topology(
    request: pytest.FixtureRequest, _gauntlet_trials: dict[Any, Any], _gauntlet_logs: Path
) -> Callable[..., Trials]:
    """Run a topology file: ``topology("case.yaml", seeds=range(20), overrides=["steps=50"])``.

    Paths are relative to the folder of the test's file. Without ``seeds`` the file's own is run.
    ``overrides`` are what ``--set`` takes. ``backend`` is ``inprocess`` or ``processes``. It returns
    `orchestrator.testing.trials.Trials`.
    """

    def run(
        file: str | Path,
        *,
        seeds: Iterable[int] | None = None,
        overrides: Iterable[str] = (),
        backend: Literal["inprocess", "processes"] = "inprocess",
    ) -> Trials:
        __tracebackhide__ = True
        from orchestrator.testing.asked import read_overrides, read_seeds
        from orchestrator.testing.trials import run_trials
        from orchestrator.topology.load import load_topology

        changes, here = read_overrides(overrides), request.path.parent
        asked = None if seeds is None else read_seeds(seeds)
        loaded = load_topology(os.path.normpath(here / file), changes, directory=here)
        chosen = asked or (loaded.plan.seed,)
        key = (here, loaded.path, loaded.hash, chosen, changes, backend)
        if key not in _gauntlet_trials:
            _gauntlet_trials[key] = run_trials(
                loaded, chosen, _gauntlet_logs, backend, changes, here, "--gauntlet-logs"
            )
        trials: Trials = _gauntlet_trials[key]
        return trials

    return run
