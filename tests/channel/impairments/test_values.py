"""Quantise and saturate: functions of values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.stats import kstest

from bus.integrity import Forger, check_sum
from bus.packets import Packet
from bus.plan import Kind, Plan, PlantPlan
from channel.contract import Ledger, Placement, Slot
from channel.impairments.quantise import Quantise
from channel.impairments.saturate import Saturate


def through(stage: Any, values: list[float]) -> tuple[Packet, Packet, Ledger]:
    genuine = Packet("s1", 0, 0, "measurement", np.array(values))
    ledger = Ledger()
    (arrived,) = stage.lane().act(Slot(0, 0, 0), [genuine], ledger)
    return genuine, arrived, ledger


def test_values_are_rounded_to_the_nearest_level_ties_to_even(driven: Any) -> None:
    _, arrived, ledger = through(driven(Quantise, step=0.5), [0.26, -0.24, 0.25, 0.75])
    assert arrived.values.tolist() == [0.5, 0.0, 0.0, 1.0]
    assert ledger.events[0].action == "altered"
    assert ledger.events[0].magnitude == pytest.approx(np.linalg.norm([0.24, 0.24, 0.25, 0.25]))


def test_the_offset_is_a_level(driven: Any) -> None:
    _, arrived, _ = through(driven(Quantise, step=1.0, offset=0.5), [0.0001, 0.9])
    assert arrived.values.tolist() == [0.5, 0.5]


def test_values_beyond_the_finest_number_stay(driven: Any) -> None:
    genuine, arrived, ledger = through(driven(Quantise, step=1e-9), [1.7e308, -1.7e308])
    assert arrived is genuine
    assert not ledger.events


def test_the_error_of_rounding_is_uniform(driven: Any) -> None:
    """Kolmogorov-Smirnov over independent values that spread over many steps; false-alarm rate 1e-6."""
    values = np.random.default_rng(4).normal(scale=100.0, size=4000)
    _, arrived, _ = through(driven(Quantise, step=0.2), values.tolist())
    errors = (arrived.values - values) / 0.2 + 0.5
    assert kstest(errors, "uniform").pvalue > 1e-6


def test_values_move_to_the_ends_of_the_range(driven: Any) -> None:
    _, arrived, _ = through(driven(Saturate, low=-1.0, high=2.0), [-3.0, 0.5, 4.0])
    assert arrived.values.tolist() == [-1.0, 0.5, 2.0]
    _, arrived, _ = through(driven(Saturate, high=2.0), [-3.0, 0.5, 4.0])
    assert arrived.values.tolist() == [-3.0, 0.5, 2.0]


def test_values_in_the_range_pass_as_the_very_packets_that_came(driven: Any) -> None:
    lane = driven(Saturate, low=-1.0).lane()
    packets = [Packet("s1", 0, 0, "measurement", np.array([0.5]))]
    assert lane.act(Slot(0, 0, 0), packets, Ledger()) is packets


@pytest.mark.parametrize(
    ("ends", "cure"), [({}, "give 'low' or 'high'"), ({"low": 2.0, "high": 1.0}, "exchange")]
)
def test_a_range_that_is_none_is_refused(driven: Any, ends: dict[str, float], cure: str) -> None:
    with pytest.raises(ValueError, match=cure):
        driven(Saturate, **ends)


@pytest.mark.parametrize("integrity", ["crc", "mac"])
def test_a_seal_that_fitted_fits_again_and_a_broken_one_stays_broken(integrity: str) -> None:
    plan = Plan(
        "p", 1, 0, 1, 0.1, PlantPlan("plant", Kind("n:N")), (), (), (), (), integrity={"s1": integrity}
    )
    forger = Forger(plan, holds_keys=True)
    placement = Placement("q", {"s1->e1": "s1->e1"}, {}, forger=forger)
    lane = Quantise(placement, step=1.0).lane("s1->e1")
    genuine = Packet("s1", 0, 0, "measurement", np.array([0.7]))
    genuine = replace(genuine, check=forger.seal(genuine))
    broken = replace(genuine, check=genuine.check ^ 1)
    (rounded,) = lane.act(Slot(0, 0, 0), [genuine], Ledger())
    assert rounded.check == forger.seal(rounded) != genuine.check
    (still_broken,) = lane.act(Slot(0, 0, 0), [broken], Ledger())
    assert still_broken.check == broken.check != forger.seal(still_broken)
    assert check_sum(rounded) == check_sum(still_broken)
