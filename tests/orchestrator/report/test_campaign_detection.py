"""What a page says of detectors whose trials are all alike, at the confidence that the topology asks for."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from orchestrator.campaign.sweep import Request, prepare, sweep
from orchestrator.command_line.campaign_output import QuietProgress
from orchestrator.report.contents import Page, Table
from orchestrator.report.detection import run_curves
from orchestrator.report.making import page_for
from orchestrator.report.recording import read_recording
from orchestrator.run import run_topology
from orchestrator.run_directory import LOG, make_run_directory
from orchestrator.topology.load import load_topology

pytest.importorskip("plotly", reason="reports are an extra")
pytest.importorskip("jinja2", reason="reports are an extra")
pytest.importorskip("pyarrow", reason="campaigns are an extra")

SURE = """
name: sure
seed: 1
period_s: 0.1
steps: 30
plant: {model: linear, A: [[0.95]], process_noise: {std: 0.3}, initial: {std: 1.0}}
sensors:
  s1: {model: linear, C: [[1.0]], noise: {std: 0.15}}
estimators:
  e1: {method: kalman, sensors: [s1], threshold: 60.0, on_alarm: reject}
attacks:
  - {bias: {value: 9.0}, on: s1->e1, steps: [20, 20]}
"""


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, dict[str, str]]]:
    """By confidence the tables of variants and of detectors, cells by column, of 20 trials each."""
    folder = tmp_path_factory.mktemp("sure")
    (folder / "sure.yaml").write_text(SURE)
    given = ["score.confidence=0.5,0.95"]
    sweep(
        prepare(Request(folder / "sure.yaml", trials=20, overrides=given, out=folder / "out")),
        QuietProgress(),
    )
    page = page_for([str(folder / "out")])
    found = {}
    for what in ("Variants", "Detectors"):
        own = table(page, what)
        for row in own.rows:
            cells = dict(zip(own.columns, map(str, row), strict=True))
            found.setdefault("0.95" if "0.95" in cells["variant"] else "0.5", {})[what] = cells
    return found


def table(page: Page, title: str) -> Table:
    """Return the table of a page whose caption begins so."""
    blocks = [block for section in page.sections for block in section.blocks]
    return next(own for own in blocks if isinstance(own, Table) and own.caption.startswith(title))


def test_a_detector_that_never_erred_is_not_said_to_be_certain(
    rows: dict[str, dict[str, dict[str, str]]],
) -> None:
    """20 trials alike: 1 - 0.05^(1/19) = 14.6 % may differ, and alarms are 6.86 packets apart or more."""
    cells = rows["0.95"]["Detectors"]
    assert cells["attacked rejected"] == "100 % [85.4, 100]"
    assert cells["genuine by false alarm"] == "none seen: above 6.86"
    assert cells["genuine rejected"] == "0 % [0, 14.6]"
    assert cells["attacks found"] == "20 of 20"
    assert cells["median delay"] == "0 (to the step)"
    assert cells["mean delay"] == "0 [0, 0.1459]"


def test_intervals_have_the_confidence_that_the_topology_asks_for(
    rows: dict[str, dict[str, dict[str, str]]],
) -> None:
    assert rows["0.5"]["Detectors"]["genuine rejected"] == "0 % [0, 3.58]"
    for column in ("passed", "diverged"):
        narrow, wide = (_width(rows[confidence]["Variants"][column]) for confidence in ("0.5", "0.95"))
        assert narrow < 0.6 * wide


def _width(cell: str) -> float:
    low, high = re.findall(r"\[(\S+), (\S+)\]", cell)[0]
    return float(high) - float(low)


def test_the_area_of_one_run_has_the_confidence_that_its_topology_asks_for(tmp_path: Path) -> None:
    areas = {}
    for confidence in (0.5, 0.95):
        attack = SURE.replace("9.0", "0.5").replace("[20, 20]", "[12, 20]")
        (tmp_path / "sure.yaml").write_text(f"{attack}score: {{confidence: {confidence}}}\n")
        topology = load_topology(tmp_path / "sure.yaml")
        directory = make_run_directory(tmp_path / str(confidence), topology.name, 1)
        report = run_topology(topology, directory, "inprocess", lambda recorded: None)
        areas[confidence] = run_curves(read_recording(report.directory / LOG))[0].roc.area
    assert areas[0.95].low < areas[0.5].low < areas[0.5].value == areas[0.95].value
