from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.stats import binom, chi2

from bus.integrity import check_sum
from bus.packets import Packet
from bus.random_streams import random_stream
from channel.contract import Ledger, Slot
from channel.draws import SlotStreams
from channel.impairments.corrupt import Corrupt, flipped


def bits_of(values: np.ndarray) -> int:
    return int.from_bytes(values.tobytes(), "little")


@pytest.mark.parametrize("bits", [1, 2, 17, 52])
def test_exactly_so_many_bits_flip_and_the_values_stay_finite(bits: int) -> None:
    generator = random_stream(1, 0, "l", "corrupt")
    for values in (np.array([1.7e308]), np.array([0.0]), np.array([-1.5, 2.0, 1e-300])):
        for _ in range(200):
            changed = flipped(values, bits, generator)
            assert np.isfinite(changed).all()
            assert (bits_of(changed) ^ bits_of(values)).bit_count() == bits


def test_every_bit_is_as_likely_to_flip() -> None:
    """Chi-square over the 128 bits of two zeros, one draw a slot of its own; rate 1e-6."""
    streams = SlotStreams(random_stream(3, 0, "l", "corrupt"))
    slots = 12_800
    counts = np.zeros(128)
    for slot in range(slots):
        counts[bits_of(flipped(np.zeros(2), 1, streams.at(slot))).bit_length() - 1] += 1
    statistic = ((counts - slots / 128) ** 2 / (slots / 128)).sum()
    assert chi2.ppf(1e-6, 127) < statistic < chi2.ppf(1 - 1e-6, 127)


def test_a_corrupted_packet_keeps_its_header_and_its_seal_which_no_longer_fits(driven: Any) -> None:
    genuine = Packet("s1", 4, 4, "measurement", np.array([1.0, 2.0]))
    genuine = replace(genuine, check=check_sum(genuine))
    ledger = Ledger()
    (corrupted,) = driven(Corrupt, probability=1.0).lane().act(Slot(4, 0, 4), [genuine], ledger)
    assert (corrupted.source, corrupted.sent_step, corrupted.sequence) == ("s1", 4, 4)
    assert corrupted.check == genuine.check != check_sum(corrupted)
    assert genuine.values.tolist() == [1.0, 2.0]
    (event,) = ledger.events
    assert event.action == "altered"
    assert event.magnitude == pytest.approx(np.linalg.norm(corrupted.values - genuine.values))


def test_even_the_greatest_change_has_a_magnitude_that_a_log_can_hold(driven: Any) -> None:
    lane, ledger = driven(Corrupt, probability=1.0).lane(), Ledger()
    for slot in range(500):
        lane.act(Slot(slot, 0, slot), [Packet("s1", 0, 0, "measurement", np.array([1.7e308] * 3))], ledger)
    assert np.isfinite([event.magnitude for event in ledger.events]).all()


def test_the_number_of_corrupted_packets_is_binomial(driven: Any) -> None:
    """Independent over steps; false-alarm rate 1e-6."""
    arrived = driven(Corrupt, probability=0.2).run(5000)
    low, high = binom.interval(1 - 1e-6, 5000, 0.2)
    assert low <= len(arrived.events_of("altered")) <= high
    assert all(len(slot) == 1 for slot in arrived.slots)


def test_a_packet_without_values_has_nothing_to_corrupt(driven: Any) -> None:
    empty = [Packet("s1", 0, 0, "measurement", np.zeros(0))]
    assert driven(Corrupt, probability=1.0).lane().act(Slot(0, 0, 0), empty, Ledger())[0] is empty[0]
