"""The reliability diagram of announced probabilities: what it holds, and that it draws."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from orchestrator.campaign.sweep import Request, prepare, sweep
from orchestrator.command_line.campaign_output import QuietProgress
from orchestrator.evidence.calibration import attack_calibration
from orchestrator.evidence.columns import select
from orchestrator.evidence.sources import load_source
from orchestrator.report.contents import Mark, Table
from orchestrator.report.making import page_for
from orchestrator.report.page import write_page
from tests.orchestrator.report.looking import look_at

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytest.importorskip("plotly", reason="reports are an extra")
pytest.importorskip("pyarrow", reason="campaigns are an extra")

FILE = Path(__file__).parents[3] / "topologies" / "forti2019" / "calibration.yaml"
RIGHT_AND_WRONG = (
    *("expect=null", "steps=80", "estimators.e3={method: kalman, sensors: [s1]}"),
    *("estimators.e2.attack_birth=0.0001", "estimators.e2.attack_survival=0.0001"),
)
"""``e1`` knows how attacks come and go, ``e2`` believes that there are hardly any, ``e3`` says nothing."""


@pytest.fixture(scope="module")
def sure(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of a filter that is calibrated and of one that is too sure."""
    out = tmp_path_factory.mktemp("sure") / "out"
    return sweep(prepare(Request(FILE, 8, overrides=RIGHT_AND_WRONG, out=out)), QuietProgress())


def test_the_diagram_shows_frequencies_over_probabilities_and_how_many_there_were(sure: Path) -> None:
    page = page_for([sure], "node")
    figure = next(own for own in page.figures if own.name == "calibration")
    right, wrong = (select(load_source(sure).table, nodes=[node]) for node in ("e1", "e2"))
    whole, curve, bars, other, _ = figure.initial.traces
    assert (curve["name"], other["name"]) == ("e1", "e2")
    assert whole["x"].tolist() == whole["y"].tolist() == [0.0, 1.0]
    own = attack_calibration(right, 10)
    used = np.flatnonzero(own.count)
    np.testing.assert_array_equal(curve["x"], own.probability[used])
    np.testing.assert_array_equal(curve["y"], own.frequency.value[used])
    np.testing.assert_allclose(curve["y"] + curve["error_y"]["array"], own.frequency.high[used])
    np.testing.assert_allclose(bars["y"], own.count[used] / (8 * 70))
    assert curve["customdata"][0] == f"{own.count[used][0]} statements"
    (table,) = (
        block
        for section in page.sections
        for block in section.blocks
        if isinstance(block, Table) and block.caption.startswith("Probability of a signal attack")
    )
    assert [row[0] for row in table.rows] == ["e1", "e2"]
    assert [row[-1] for row in table.rows] == [Mark("calibrated", "good"), Mark("miscalibrated", "bad")]
    error = attack_calibration(wrong, 10).error
    assert table.rows[1][2] == f"{error.value:.4g} [{error.low:.3g}, {error.high:.3g}]"


def test_the_diagram_draws_on_a_telephone(browser: Browser, sure: Path, tmp_path: Path) -> None:
    out = tmp_path / "report.html"
    write_page(page_for([sure]), out)
    with look_at(browser, out, width=390, scheme="dark") as look:
        assert look.complaints == []
        assert look.overflow() <= 0
        assert look.empty_plots() == []
        assert look.page.locator("figure#figure-calibration .plot .barlayer .point").count() > 10
