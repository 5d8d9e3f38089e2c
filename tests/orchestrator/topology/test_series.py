from __future__ import annotations

from pathlib import Path

import pytest

from orchestrator.topology.load import find_problems, load_topology
from orchestrator.topology.series import SeriesError, read_series


@pytest.mark.parametrize("text", ["1,2\n3,4.5\n", "a, b\n1,2\n\n3,4.5\n", "\ufeffa,b\r\n1,2\r\n3,4.5\r\n"])
def test_a_csv_file_is_read_with_or_without_a_header(tmp_path: Path, text: str) -> None:
    path = tmp_path / "series.csv"
    path.write_text(text, encoding="utf-8")
    assert read_series(str(path)) == [[1.0, 2.0], [3.0, 4.5]]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1,2\n3\n", "series.csv:2 has 1 values, the first row 2"),
        ("a\n1\nx\n", "series.csv:3: 'x' is not a finite number"),
        ("1\nnan\n", "series.csv:2: 'nan' is not a finite number"),
        ("1,b\n", "series.csv:1: 'b' is not a finite number"),
        ("a,b\n", "holds no row"),
        ("", "holds no row"),
    ],
)
def test_what_is_no_series_is_told_with_its_line(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "series.csv"
    path.write_text(text)
    with pytest.raises(SeriesError) as caught:
        read_series(str(path))
    assert told in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(SeriesError, match=r"nothing.csv cannot be read"):
        read_series(str(tmp_path / "nothing.csv"))


def test_a_place_in_a_log_needs_a_topic_and_a_field() -> None:
    with pytest.raises(SeriesError, match="names no field"):
        read_series("run.mcap#truth")


SERIES = """
period_s: 0.1
steps: 20
plant: {model: linear, A: [[1.0]], process_noise: {std: 0.1}, initial: {std: 1.0}}
sensors: {s1: {model: linear, C: [[1.0]], noise: {std: 0.1}}}
estimators: {e1: {method: kalman}}
attacks: [{series: {values: pulse.csv}, on: s1->e1}]
"""


def test_a_topology_may_name_a_file_of_rows_and_its_log_holds_the_rows(tmp_path: Path) -> None:
    (tmp_path / "pulse.csv").write_text("value\n1\n2.5\n")
    path = tmp_path / "topology.yaml"
    path.write_text(SERIES)
    topology = load_topology(path)
    assert topology.plan.stages[0].kind.parameters["values"] == [[1.0], [2.5]]
    assert topology.document["attacks"][0]["series"]["values"] == [[1.0], [2.5]]


def test_a_file_of_rows_that_is_not_there_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "topology.yaml"
    path.write_text(SERIES)
    ((problem, *_), _) = find_problems(path)
    assert "pulse.csv cannot be read" in str(problem)
    assert problem.line == 7
