"""Seals: what accidents and forgers change is refused, as far as the kind of seal can tell."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from bus.integrity import Forger, Gate, seal_of
from bus.packets import UNSEALED, Packet
from bus.plan import Kind, Plan, PlantPlan

NOWHERE = Kind("nowhere:Nothing")


def plan(seed: int = 1, **integrity: str) -> Plan:
    return Plan("p", seed, 0, 10, 0.1, PlantPlan("plant", NOWHERE), (), (), (), (), integrity=integrity)


def sealed(of: Plan, source: str = "s1", step: int = 3) -> Packet:
    packet = Packet(source, step, step, "measurement", np.array([1.5, -2.0]))
    seal = seal_of(of, source)
    return packet if seal is None else replace(packet, check=seal(packet))


@pytest.mark.parametrize("integrity", ["crc", "mac"])
@given(bit=st.integers(0, 127))
def test_a_flipped_bit_is_noticed(integrity: str, bit: int) -> None:
    of = plan(s1=integrity)
    packet = sealed(of)
    raw = bytearray(packet.values.tobytes())
    raw[bit // 8] ^= 1 << bit % 8
    damaged = replace(packet, values=np.frombuffer(bytes(raw)))
    gate = Gate(of, ["s1"])
    assert gate.admits(packet)
    assert not gate.admits(damaged)


@pytest.mark.parametrize("integrity", ["crc", "mac"])
@pytest.mark.parametrize(
    "change", [{"sent_step": 4}, {"sequence": 4}, {"kind": "exchange"}, {"source": "s2"}]
)
def test_the_seal_covers_the_header(integrity: str, change: dict[str, object]) -> None:
    of = plan(s1=integrity, s2=integrity)
    assert not Gate(of, ["s1", "s2"]).admits(replace(sealed(of), **change))


def test_without_seals_everything_of_a_known_source_is_let_in() -> None:
    of = plan()
    packets = [sealed(of), replace(sealed(of), values=np.zeros(2))]
    assert Gate(of, ["s1"]).admit(packets) is packets
    assert packets[0].check == UNSEALED


def test_a_source_that_the_receiver_does_not_listen_to_is_refused() -> None:
    of = plan()
    stranger, known = sealed(of), sealed(of, "s2")
    (let_in,) = Gate(of, ["s2"]).admit([stranger, known])
    assert let_in is known


def test_a_check_sum_can_be_forged_and_a_key_must_be_known() -> None:
    for integrity, holds_keys, passes in (
        ("crc", False, True),
        ("mac", False, False),
        ("mac", True, True),
        ("none", False, True),
    ):
        of = plan(**({} if integrity == "none" else {"s1": integrity}))
        false = replace(sealed(of), values=np.array([9.0, 9.0]))
        false = replace(false, check=Forger(of, holds_keys).seal(false))
        assert Gate(of, ["s1"]).admits(false) is passes


def test_a_packet_made_up_for_a_sender_with_a_key_has_a_seal_as_a_genuine_one_has() -> None:
    of = plan(s1="mac")
    made_up = Packet("s1", 3, 3, "measurement", np.zeros(2))
    seal = Forger(of, holds_keys=False).seal(made_up)
    assert seal != UNSEALED
    assert not Gate(of, ["s1"]).admits(replace(made_up, check=seal))


def test_keys_differ_between_nodes_and_runs_and_fit_into_json() -> None:
    keyed = {
        sealed(plan(seed, s1="mac", s2="mac"), source).check for seed in (1, 2) for source in ("s1", "s2")
    }
    assert len(keyed) == 4
    assert all(0 <= check < 2**53 for check in keyed)


def test_nan_values_are_no_hole_in_the_seal() -> None:
    of = plan(s1="mac")
    assert not Gate(of, ["s1"]).admits(replace(sealed(of), values=np.array([np.nan, -2.0])))
