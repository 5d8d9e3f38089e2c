"""A run to report on, its page, and a headless Chromium to look at pages with."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from orchestrator.command_line.campaign_output import QuietProgress
from orchestrator.report.contents import Page
from orchestrator.report.export import find_browser
from orchestrator.run import run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.topology.load import load_topology
from tests.orchestrator.report.looking import Look, look_at
from tests.playing import LOSSY_RING, RING

if TYPE_CHECKING:
    from playwright.sync_api import Browser

ATTACKED = (
    LOSSY_RING.format(name="attacked-run", seed=7, steps=60)
    + """\
attacks:
  - {bias: {value: 5.0}, on: s2->e2, steps: [20, 31]}
  - {bias: {value: 0.3}, on: s3->e3, steps: [40, 45]}
expect:
  divergences: 0
  rmse.position: {node: e1, at_most: 0.001}
"""
)


@pytest.fixture(scope="session")
def attacked_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a run with attacks, losses, a detector, and an expectation that fails."""
    home = tmp_path_factory.mktemp("attacked")
    (home / "attacked.yaml").write_text(ATTACKED)
    topology = load_topology(home / "attacked.yaml")
    directory = make_run_directory(home / "out", topology.plan.name, topology.plan.seed)
    run_topology(topology, directory, "inprocess", lambda recorded: None)
    return directory


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """A headless Chromium; without one the tests that look at pages are skipped."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is in the extra `dev`")
    program = find_browser()
    if program is None:
        pytest.skip("no Chromium or Chrome is installed to look at the page with")
    with sync_api.sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"], timeout=60_000)
        yield started
        started.close()


@pytest.fixture(scope="session")
def run_file(attacked_run: Path) -> Path:
    """The report of the run, as a file."""
    from orchestrator.report.making import page_for
    from orchestrator.report.page import write_page

    out = attacked_run.parent / "report.html"
    write_page(page_for([attacked_run]), out)
    return out


@pytest.fixture(scope="session")
def wide(browser: Browser, run_file: Path) -> Iterator[Look]:
    """The run's report on a wide, light screen."""
    with look_at(browser, run_file, width=1280, scheme="light") as look:
        yield look


@pytest.fixture(scope="session")
def narrow(browser: Browser, run_file: Path) -> Iterator[Look]:
    """The run's report on a telephone whose owner prefers dark pages."""
    with look_at(browser, run_file, width=390, scheme="dark") as look:
        yield look


SWEPT = (
    RING.format(name="swept", seed=3, steps=30)
    + """\
  lone: {method: kalman, sensors: [s1]}
  strict: {method: kalman, sensors: [s1], threshold: 9.0}
attacks:
  - {bias: {value: 4.0}, on: s2->e2, steps: [12, 17]}
expect:
  divergences: 0
"""
)


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a campaign of three trials, and of their unattacked twins."""
    from orchestrator.campaign.sweep import Request, prepare, sweep

    home = tmp_path_factory.mktemp("swept")
    (home / "swept.yaml").write_text(SWEPT)
    request = Request(
        file=home / "swept.yaml",
        trials=3,
        out=home / "campaign",
        twins=True,
    )
    return sweep(prepare(request), QuietProgress())


@pytest.fixture(scope="session")
def campaign_page(campaign: Path) -> Page:
    """The report of the campaign, before it is HTML."""
    from orchestrator.report.making import page_for

    return page_for([campaign])


@pytest.fixture(scope="session")
def campaign_file(campaign: Path, campaign_page: Page) -> Path:
    """The report of the campaign, as a file."""
    from orchestrator.report.page import write_page

    out = campaign.parent / "report.html"
    write_page(campaign_page, out)
    return out
