"""Figures over time: as far as the record goes, and every value at the step that it is of."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest

from orchestrator.report.contents import Figure, Page, Trace
from orchestrator.report.making import page_for
from orchestrator.report.recording import read_recording
from orchestrator.run import run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.topology.load import load_topology
from tests.orchestrator.report.conftest import ATTACKED

RECORDED = 35

PREDICTING = """
from nodes.contract import Belief
from nodes.estimators.kalman import Kalman

class Predicting(Kalman):
    def __init__(self, setting):
        super().__init__(setting)
        self.A = setting.plant.A

    def estimate(self, step):
        now = super().estimate(step)
        covariance = self.A @ now.covariance @ self.A.T + 0.01
        return Belief(state=self.A @ now.state, covariance=covariance, refers_to=step + 1)
"""
TWO_KINDS = """
name: two-kinds
steps: 20
period_s: 0.1
plant: {model: linear, A: [[0.9]], process_noise: {std: 0.1}, initial: {std: 1.0}}
sensors: {s1: {model: linear, C: [[1.0]], noise: {std: 0.1}}}
estimators:
  now: {method: kalman, sensors: [s1]}
  next: {method: "./predicting.py:Predicting", sensors: [s1]}
"""


def run(home: Path, text: str, stop: int | None = None) -> Path:
    """Run a topology and return its directory; at a step it may be interrupted."""

    def progress(recorded: int) -> None:
        if stop is not None and recorded >= stop:
            signal.raise_signal(signal.SIGINT)

    (home / "topology.yaml").write_text(text)
    topology = load_topology(home / "topology.yaml")
    directory = make_run_directory(home / "out", "run", 1)
    run_topology(topology, directory, "inprocess", progress)
    return directory


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    text = ATTACKED.replace("steps: 60\n", "steps: 3000\n")
    assert text != ATTACKED
    return run(tmp_path_factory.mktemp("interrupted"), text, RECORDED)


@pytest.fixture(scope="module")
def page(interrupted: Path) -> Page:
    return page_for([interrupted])


@pytest.fixture(scope="module")
def two_kinds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("kinds")
    (home / "predicting.py").write_text(PREDICTING)
    return run(home, TWO_KINDS)


def over_time(page: Page) -> list[Figure]:
    named = ("tracking", "errors", "disagreement", "consistency", "detection", "traffic")
    found = [figure for figure in page.figures if figure.name in named]
    assert len(found) == len(named)
    return found


def figure(page: Page, name: str) -> Figure:
    return next(own for own in page.figures if own.name == name)


def of(traces: list[Trace], name: str) -> Trace:
    return next(trace for trace in traces if trace["name"] == name)


def test_every_figure_ends_with_the_record_and_marks_its_end(page: Page, interrupted: Path) -> None:
    steps = read_recording(interrupted / "run.mcap").steps
    assert RECORDED <= steps < 100
    for own in over_time(page):
        low, high = own.layout["xaxis"]["range"]
        assert low <= 0 < steps <= high <= 1.05 * steps, own.name
        assert own.layout["annotations"][0]["text"] == f"recorded to step {steps - 1} of 2,999"
        for view in own.views.values():
            xs = [x for trace in view.traces for x in trace["x"] if x is not None and np.isfinite(x)]
            assert max(xs) < steps, own.name
            ends = [shape for shape in view.layout["shapes"] if shape.get("x0") == steps - 0.5]
            assert len(ends) == 1, own.name


def test_steps_that_never_ran_sent_no_packets_and_are_not_drawn_as_if_they_had_sent_none(page: Page) -> None:
    sent = of(list(figure(page, "traffic").initial.traces), "sent")
    assert (sent["y"] > 0).all()


def test_a_whole_run_has_no_mark_at_its_end(attacked_run: Path) -> None:
    for own in over_time(page_for([attacked_run])):
        assert "annotations" not in own.layout
        for view in own.views.values():
            assert not any(shape.get("x0") == 59.5 for shape in view.layout["shapes"])


def test_a_prediction_stands_at_the_step_that_it_is_of_in_every_figure(two_kinds: Path) -> None:
    page, recording = page_for([two_kinds]), read_recording(two_kinds / "run.mcap")
    apart = np.abs(recording.state[1, :, 0] - recording.truth[:, 0])
    assert np.isnan(apart[0])
    assert np.isfinite(apart[1:]).all()
    errors = list(figure(page, "errors").views["state",].traces)
    np.testing.assert_allclose(of(errors, "next")["y"], apart)
    tracking = figure(page, "tracking").views["next", "0"].traces
    below = next(trace for trace in tracking if trace.get("yaxis") == "y2" and "fill" not in trace)
    np.testing.assert_allclose(np.abs(below["y"]), apart)
    nees = of(list(figure(page, "consistency").views[("next",)].traces), "NEES")
    np.testing.assert_allclose(nees["y"], np.square(apart / recording.sigma[1, :, 0]))


def test_the_rms_of_all_is_of_all(two_kinds: Path) -> None:
    traces = list(figure(page_for([two_kinds]), "errors").views["state",].traces)
    now, after, whole = (of(traces, name)["y"] for name in ("now", "next", "RMS of all"))
    assert np.isnan(whole[0])
    np.testing.assert_allclose(whole[1:], np.sqrt((now**2 + after**2) / 2.0)[1:])


def test_an_estimator_that_tells_no_nis_has_no_panel_for_it(two_kinds: Path) -> None:
    views = figure(page_for([two_kinds]), "consistency").views
    assert {trace.get("yaxis") for trace in views[("now",)].traces} >= {"y", "y2"}
    assert "y2" not in {trace.get("yaxis") for trace in views[("next",)].traces}
    assert views[("next",)].layout["yaxis"]["domain"] == [0, 1]
    assert views[("next",)].layout["yaxis2"]["visible"] is False
    summary = figure(page_for([two_kinds]), "consistency-summary").initial.traces
    assert of(list(summary), "NIS")["x"] == ["now"]
