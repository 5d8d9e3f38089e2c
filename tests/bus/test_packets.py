from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.messages import Inbox, Transmission, decoder, encode
from bus.packets import (
    Delivery,
    Packet,
    Sending,
    inbox,
    packets_of_inbox,
    packets_of_transmission,
    transmission,
)

finite = st.floats(allow_nan=False, allow_infinity=False)
payloads = st.lists(finite, max_size=6).map(lambda values: np.array(values, dtype=np.float64))


def same(left: Packet, right: Packet) -> bool:
    names = ("source", "sent_step", "sequence", "kind")
    return all(getattr(left, name) == getattr(right, name) for name in names) and (
        left.values.tobytes() == right.values.tobytes()
    )


@given(st.lists(st.tuples(st.sampled_from(["s1", "e2"]), st.integers(0, 9), payloads), max_size=5))
def test_an_inbox_returns_the_packets_that_were_put_in_to_the_last_bit(
    rows: list[tuple[str, int, np.ndarray]],
) -> None:
    packets = [Packet(source, step, step, "exchange", values) for source, step, values in rows]
    message = decoder(Inbox).decode(encode(inbox(9, 0.45, 0, packets)))
    assert all(map(same, packets_of_inbox(message), packets))
    assert len(message.source) == len(packets)


@given(payloads)
def test_a_transmission_carries_one_payload(values: np.ndarray) -> None:
    message = decoder(Transmission).decode(encode(transmission(3, 0.15, 0, 3, values.tolist())))
    (packet,) = packets_of_transmission(message, "s1", "measurement")
    assert same(packet, Packet("s1", 3, 3, "measurement", values))


@given(st.lists(payloads, max_size=1), st.sampled_from([-1, 7]))
def test_a_form_and_its_message_tell_the_same_packets(values: list[np.ndarray], check: int) -> None:
    packets = [Packet("s1", 3, 3, "measurement", own, check) for own in values]
    sending, delivered = Sending(3, 0.15, 0, packets), Delivery(3, 0.15, 0, packets, untouched=True)
    sent = decoder(Transmission).decode(encode(sending.message()))
    arrived = decoder(Inbox).decode(encode(delivered.message()))
    for told, form in (
        (packets_of_transmission(sent, "s1", "measurement"), sending.packets),
        (packets_of_inbox(arrived), delivered.packets),
    ):
        assert [packet.check for packet in told] == [packet.check for packet in form]
        assert len(told) == len(form)
        assert all(map(same, told, form))


def test_a_quiet_slot_holds_no_packet() -> None:
    assert packets_of_transmission(transmission(3, 0.15, 0, 3, None), "e1", "exchange") == []


@pytest.mark.parametrize(
    ("offset", "sequence"), [([1], [0]), ([0, 5], [0, 1]), ([0, 2, 1], [0, 1, 2]), ([0], [0, 1]), ([], [0])]
)
def test_a_slot_whose_lists_do_not_fit_one_another_is_refused(offset: list[int], sequence: list[int]) -> None:
    message = Transmission(step=0, t=0.0, round=0, sequence=sequence, offset=offset, values=[1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match=r"partition|offsets"):
        packets_of_transmission(message, "s1", "measurement")
