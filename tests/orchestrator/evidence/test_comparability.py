"""Warnings before a comparison: what makes a metric another thing for one than for another."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from orchestrator.evidence.columns import select
from orchestrator.evidence.comparison import compare, warnings
from orchestrator.evidence.contenders import Contender
from orchestrator.evidence.facts import facts
from orchestrator.evidence.wording import lines
from orchestrator.registry import portable_name

TRIALS = 8
METRICS = ("rmse.state", "peak.state", "packets.sent")


def table(nodes: int) -> pa.Table:
    """Return rows of so many estimators in each trial."""
    rows = [(trial, f"e{node}") for trial in range(TRIALS) for node in range(nodes)]
    values = np.random.default_rng(1).lognormal(0.0, 0.4, len(rows))
    return pa.table(
        {
            "variant": pa.array([0] * len(rows), pa.int32()),
            "trial": pa.array([trial for trial, _ in rows], pa.int32()),
            "seed": pa.array([1] * len(rows), pa.int64()),
            "node": pa.array([node for _, node in rows]),
            "method": pa.array(["kalman"] * len(rows)),
            "status": pa.array(["scored"] * len(rows)),
            **{metric: pa.array(values) for metric in METRICS},
        }
    )


PLANT = {"model": "linear", "A": [[1.0]], "process_noise": {"std": 0.2, "mean": None}}
RAN = {
    "plant": PLANT,
    "period_s": 0.1,
    "steps": 50,
    "attacks": [],
    "score": {"from_step": 0, "node_series": False},
}


def warned(*documents: dict[str, Any], nodes: Sequence[int] = ()) -> list[str]:
    """Return the warnings on contenders that ran these topologies, each with so many estimators."""
    numbers = nodes or [1] * len(documents)
    contenders = [
        Contender(name, name, select(table(n)), document)
        for name, document, n in zip("ABCDEFGH", documents, numbers, strict=False)
    ]
    found = compare(contenders, METRICS)
    assert facts(found)["warnings"] == warnings(found)
    said = lines(found)
    assert said[: len(warnings(found))] == [f"Warning: {warning}." for warning in warnings(found)]
    assert not any(line.startswith("Warning") for line in said[len(warnings(found)) :])
    return warnings(found)


@pytest.mark.parametrize(
    ("change", "warning"),
    [
        (
            {"plant": {"model": "tank", "A": None}},
            "different plants (plant.model is linear for A, tank for B)",
        ),
        (
            {"plant": {**PLANT, "process_noise": {"std": 1, "mean": None}}},
            "different plants (plant.process_noise.std is 0.2 for A, 1 for B)",
        ),
        ({"plant": {**PLANT, "A": [[0.9]]}}, "different plants (plant.A is [[1]] for A, [[0.9]] for B)"),
        ({"period_s": 0.05}, "a step is not as long (period_s is 0.1 for A, 0.05 for B)"),
        ({"steps": 60}, "their runs are not as long (steps is 50 for A, 60 for B)"),
        ({"score": {"from_step": 10}}, "they are not scored alike (score.from_step is 0 for A, 10 for B)"),
    ],
)
def test_what_makes_a_metric_another_thing_is_warned_of(change: dict[str, Any], warning: str) -> None:
    (found,) = warned(RAN, {**RAN, **change})
    assert warning in found


@pytest.mark.parametrize(
    "change",
    [
        {"attacks": [{"bias": {"value": 1.0}}]},
        {"channel": {"s*->e*": [{"bernoulli": {"loss": 0.5}}]}},
        {"sensors": {"s1": {"model": "linear"}}},
        {"seed": 8},
        {"plant": {**PLANT, "A": [[1]]}},
        {"score": {"from_step": 0, "node_series": True}},
    ],
)
def test_what_people_compare_is_not_warned_of(change: dict[str, Any]) -> None:
    assert warned(RAN, {**RAN, **change}) == []


def test_a_warning_stays_short_however_many_are_compared() -> None:
    ran = [{**RAN, "steps": 50 + 10 * (i // 2), "plant": {**PLANT, "A": [[i] * 50]}} for i in range(8)]
    plants, lengths = warned(*ran)
    assert len(plants) < 320
    assert "steps is 50 for A and B, 60 for C and D, 70 for E and F, 80 for G and H" in lengths


def test_a_users_own_plant_is_the_same_in_a_log_and_in_a_campaign(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("class Mine: ...\n")
    logged, kept = (
        {**RAN, "plant": {"model": name}} for name in (portable_name(f"{file}:Mine"), f"{file}:Mine")
    )
    assert warned(logged, kept) == []
    file.write_text("class Mine:\n    changed = True\n")
    assert "different plants" in warned(logged, kept)[0]


def test_a_sum_over_more_estimators_is_warned_of_and_a_mean_is_not() -> None:
    largest, summed = warned(RAN, RAN, nodes=(1, 4))
    assert (
        largest
        == "peak.state is the largest of the estimators of each, which are not as many: 1 for A, 4 for B"
    )
    assert summed.startswith("packets.sent adds up the estimators of each")
    assert warned(RAN, RAN, nodes=(4, 4)) == []
