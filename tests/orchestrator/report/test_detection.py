"""Verdicts over time: no kind of packet hides another, and none is off the figure."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from orchestrator.report.contents import Figure, Trace
from orchestrator.report.edges import with_edges
from orchestrator.report.making import page_for
from orchestrator.run import run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.topology.load import load_topology

JUDGING = """
from nodes.contract import Belief, Detection
from nodes.estimators.kalman import Kalman

class Judging(Kalman):
    \"\"\"Gives every third packet {high}, the others {low}, and rejects what is above half of {high}.\"\"\"

    def correct(self, step, packets):
        values = [({high} if packet.sequence % 3 == 0 else {low}) for packet in packets]
        self.said = [Detection(packet.source, packet.sequence, value, value > {high} / 2)
                     for packet, value in zip(packets, values)]
        return super().correct(step, packets)

    def estimate(self, step):
        own = super().estimate(step)
        return Belief(state=own.state, covariance=own.covariance, detections=self.said)
"""
JUDGED = """
name: judged
steps: 400
period_s: 0.1
plant: {model: linear, A: [[0.9]], process_noise: {std: 0.1}, initial: {std: 1.0}}
sensors: {s1: {model: linear, C: [[1.0]], noise: {std: 0.1}}}
estimators: {e1: {method: "./judging.py:Judging", sensors: [s1]}}
attacks: [{bias: {value: 3.0}, on: s1->e1, steps: [100, 299]}]
"""


def timeline(home: Path, low: str, high: str) -> Figure:
    """Return the figure of an estimator whose statistics are of two values."""
    (home / "judging.py").write_text(JUDGING.format(low=low, high=high))
    (home / "judged.yaml").write_text(JUDGED)
    directory = make_run_directory(home / "out", "judged", 1)
    run_topology(load_topology(home / "judged.yaml"), directory, "inprocess", lambda recorded: None)
    return next(figure for figure in page_for([directory]).figures if figure.name == "detection")


def points(traces: list[Trace]) -> list[Trace]:
    return [trace for trace in traces if isinstance(trace["y"], np.ndarray)]


def test_probabilities_stand_on_a_linear_axis_that_shows_the_smallest(tmp_path: Path) -> None:
    axis = timeline(tmp_path, "1e-12", "0.97").initial.layout["yaxis"]
    assert axis.get("type", "linear") == "linear"
    assert "range" not in axis


def test_false_alarms_are_drawn_over_all_other_packets(tmp_path: Path) -> None:
    drawn = points(list(timeline(tmp_path, "0.1", "0.9").initial.traces))
    assert drawn[-1]["name"] == "genuine, rejected"
    assert drawn[-1]["y"].size > 50
    assert {trace["name"] for trace in drawn if trace["y"].size} == {
        *("genuine, accepted", "genuine, rejected", "attacked, accepted", "attacked, rejected")
    }


@pytest.mark.parametrize(("low", "high"), [("1e-20 * 10.0 ** (step % 20)", "40.0"), ("2.0", "1e30")])
def test_every_packet_has_a_point_on_the_figure(tmp_path: Path, low: str, high: str) -> None:
    figure = timeline(tmp_path, low, high)
    axis = figure.initial.layout["yaxis"]
    assert axis["type"] == "log"
    bottom, top = axis["range"]
    traces = with_edges(figure.initial.traces, {**figure.layout, **figure.initial.layout})
    seen = sum(
        np.sum((np.log10(trace["y"]) >= bottom) & (np.log10(trace["y"]) <= top)) for trace in points(traces)
    )
    assert seen == 400
