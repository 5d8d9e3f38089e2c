"""Loops, smart sensors, signals and attacks that know the model, in one process and in many."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.conftest import Gauntlet

FOLDER = Path(__file__).parents[2] / "topologies" / "adversary"


@pytest.mark.parametrize("name", ["covert", "optimal_linear", "signal_attack"])
def test_one_process_or_many_writes_the_same_bytes(gauntlet: Gauntlet, name: str) -> None:
    many = gauntlet.log(FOLDER / f"{name}.yaml", out="many")
    assert many == gauntlet.log(FOLDER / f"{name}.yaml", "--backend", "inprocess", out="one")
