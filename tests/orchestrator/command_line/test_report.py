"""`gauntlet report`: one HTML file, pictures beside it, and what it says when it cannot."""

from __future__ import annotations

import html
import re
import sys
from pathlib import Path

import pytest

from orchestrator.report.export import find_browser
from tests.orchestrator.command_line.conftest import ROOT, Command

pytest.importorskip("plotly", reason="reports are an extra")
pytest.importorskip("jinja2", reason="reports are an extra")
pytest.importorskip("pyarrow", reason="reports are an extra")

NEEDS_BROWSER = pytest.mark.skipif(
    find_browser() is None, reason="no Chromium or Chrome to draw pictures with"
)


@pytest.mark.parametrize("given", ["", "run.mcap"])
def test_a_run_is_reported_from_its_directory_or_its_log(
    gauntlet: Command, home: Path, finished_run: Path, given: str
) -> None:
    answer = gauntlet("report", finished_run / given, "--out", "out/report.html")
    assert (answer.code, answer.err) == (0, "")
    assert re.fullmatch(r"wrote out/report.html \(\d\.\d MB\)\n", answer.out)
    text = (home / "out" / "report.html").read_text()
    assert text.startswith("<!doctype html>")
    assert "<strong>PASSED</strong>" in text


def test_the_head_of_a_report_tells_how_much_of_a_run_is_there(
    gauntlet: Command, home: Path, finished_run: Path, cut_off: tuple[Path, int]
) -> None:
    log, steps = cut_off
    there = f"{steps} of 24 steps"
    assert gauntlet("report", log).code == 0
    head = _head(home / "report.html")
    assert f"INCOMPLETE {there} recorded, {3 * (24 - steps)} estimates missing; as far as they go, " in head
    assert f"Steps recorded {steps} of 24 {24 - steps} missing" in head
    whole = (home / "report.html").read_text()
    assert f"cut off; gauntlet log recover makes it whole; {there}" in whole
    assert gauntlet("report", log, "--by", "node").code == 0
    head = _head(home / "report.html")
    assert "INCOMPLETE All that was expected held in 0 of 1 trials" in head
    assert f"The record of small is incomplete, {there} recorded: its figures are those of what is" in head
    assert gauntlet("report", log, finished_run).code == 0
    head = _head(home / "report.html")
    assert f"The record of small (cut.mcap) is incomplete, {there} recorded" in head
    assert "smallest RMSE" not in head
    assert gauntlet("report", finished_run).code == 0
    assert "recorded" not in _head(home / "report.html")


def _head(page: Path) -> str:
    """Return the text of a page down to its first section, in which spaces stand for tags."""
    text = page.read_text()
    part = text[text.index("<h1>") : text.index("<nav")]
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", part)).split())


def test_json_tells_what_was_written(gauntlet: Command, home: Path, finished_run: Path) -> None:
    answer = gauntlet("report", finished_run, "--json")
    size = (home / "report.html").stat().st_size
    assert answer.json() == {"report": "report.html", "bytes": size, "figures": []}


def test_what_is_no_run_is_bad_input_that_names_the_place(gauntlet: Command, home: Path) -> None:
    answer = gauntlet("report", "nowhere", "--out", "report.html")
    assert answer.code == 2
    assert "nowhere holds no run and no campaign" in answer.err
    assert not (home / "report.html").exists()


def test_a_place_that_cannot_be_written_is_bad_input(
    gauntlet: Command, home: Path, finished_run: Path
) -> None:
    (home / "file").write_text("")
    answer = gauntlet("report", finished_run, "--out", "file/report.html")
    assert answer.code == 2
    assert "file/report.html cannot be written" in answer.err


@pytest.mark.parametrize("command", ["report", "reproduce"])
@pytest.mark.parametrize("form", ["svg", "png"])
def test_a_kind_of_picture_without_pictures_is_refused_with_the_cure(
    gauntlet: Command, home: Path, finished_run: Path, command: str, form: str
) -> None:
    given = {"report": finished_run, "reproduce": ROOT / "topologies/ding2021"}[command]
    answer = gauntlet(command, given, "--format", form, "--out", "out")
    assert answer.code == 2
    assert f"--format {form} is the kind of picture that --figures writes" in answer.err
    assert "add --figures DIR" in answer.err
    assert not (home / "out").exists()


def test_pictures_of_pages_that_are_not_written_are_refused_with_the_cure(
    gauntlet: Command, home: Path
) -> None:
    answer = gauntlet("reproduce", ROOT / "topologies/ding2021", "--no-reports", "--figures", "pictures")
    assert answer.code == 2
    assert "leave out --no-reports, or --figures" in answer.err
    assert list(home.iterdir()) == [home / "small.yaml"], "no campaign was begun"


@pytest.mark.parametrize("library", ["plotly.offline", "jinja2"])
def test_a_missing_library_is_told_with_its_cure(
    gauntlet: Command, finished_run: Path, monkeypatch: pytest.MonkeyPatch, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    answer = gauntlet("report", finished_run)
    assert answer.code == 2
    assert f"a report needs {library.partition('.')[0]}: pip install -e '.[report]' in" in answer.err


def test_pictures_without_a_browser_are_refused_with_the_cure(
    gauntlet: Command, home: Path, finished_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("kaleido", reason="pictures are an extra")
    monkeypatch.setenv("PATH", str(home))
    monkeypatch.delenv("BROWSER_PATH", raising=False)
    answer = gauntlet("report", finished_run, "--figures", "figures")
    assert answer.code == 2
    assert "needs Chromium or Chrome, and none was found" in answer.err
    assert "BROWSER_PATH" in answer.err


@NEEDS_BROWSER
def test_figures_become_pictures_and_equal_ones_equal_files(tmp_path: Path, finished_run: Path) -> None:
    pytest.importorskip("kaleido", reason="pictures are an extra")
    from orchestrator.report.export import export
    from orchestrator.report.making import page_for

    figures = [
        figure for figure in page_for([finished_run]).figures if figure.name in ("network", "tracking")
    ]
    paths = export(figures, tmp_path / "a", "svg")
    assert [path.name for path in paths] == ["network.svg", "tracking.svg"]
    for path, told in zip(paths, (">e2<", ">estimate ± 2σ<"), strict=True):
        assert told in path.read_text()
    (again,) = export(figures[:1], tmp_path / "b", "svg")
    assert again.read_text() == paths[0].read_text()


@pytest.mark.slow
@NEEDS_BROWSER
def test_every_figure_becomes_a_picture(gauntlet: Command, home: Path, finished_run: Path) -> None:
    pytest.importorskip("kaleido", reason="pictures are an extra")
    answer = gauntlet("report", finished_run, "--figures", "pictures", "--format", "png", "--json")
    names = answer.json()["figures"]
    assert len(names) >= 8
    for name in names:
        assert (home / name).read_bytes().startswith(b"\x89PNG")


@NEEDS_BROWSER
def test_a_browser_that_does_not_run_is_told_with_the_cure(
    gauntlet: Command, home: Path, finished_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("kaleido", reason="pictures are an extra")
    (home / "chrome").write_text("#!/bin/sh\nexit 1\n")
    (home / "chrome").chmod(0o755)
    monkeypatch.setenv("BROWSER_PATH", str(home / "chrome"))
    answer = gauntlet("report", finished_run, "--figures", "pictures")
    assert answer.code == 2
    assert "drew no pictures" in answer.err
