from __future__ import annotations

import pytest

from bus import keys
from bus.intake import Intake
from bus.messages import Credit, Truth, encode
from bus.packets import transmission

TRUTH = keys.truth("plant")
EXCHANGE = keys.tx("e1", keys.EXCHANGE)


def truth(step: int) -> bytes:
    return encode(Truth(step=step, t=0.1 * step, state=[1.0]))


def test_the_next_slot_of_a_topic_is_admitted() -> None:
    intake = Intake({})
    messages = [intake.admit(TRUTH, truth(step)) for step in range(3)]
    assert [message.step for message in messages if message] == [0, 1, 2]
    assert not intake.rejected


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"{",
        b"null",
        b"[]",
        b'{"step":1}',
        b'{"step":"1","t":0.0,"state":[]}',
        b"\xff\xfe",
        truth(0),
        truth(5),
    ],
)
def test_malformed_duplicate_and_premature_messages_are_refused_and_counted(payload: bytes) -> None:
    intake = Intake({})
    intake.admit(TRUTH, truth(0))
    assert intake.admit(TRUTH, payload) is None
    assert intake.rejected == {TRUTH: 1}
    assert intake.admit(TRUTH, truth(1)) is not None, "a refusal disturbs nothing else"


def test_an_unknown_topic_is_refused() -> None:
    intake = Intake({})
    assert intake.admit("nonsense/x", b"{}") is None
    assert intake.rejected == {"nonsense/x": 1}


def test_exchange_rounds_are_counted_inside_a_step() -> None:
    intake = Intake({EXCHANGE: 2})
    slots = [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert all(intake.admit(EXCHANGE, encode(transmission(k, 0.0, r, 0, None))) for k, r in slots)
    assert intake.admit(EXCHANGE, encode(transmission(2, 0.0, 1, 0, None))) is None


def test_a_round_that_a_topic_does_not_have_is_refused() -> None:
    intake = Intake({})
    assert intake.admit(EXCHANGE, encode(transmission(0, 0.0, 0, 0, None))) is not None
    assert intake.admit(EXCHANGE, encode(transmission(0, 0.0, 1, 0, None))) is None
    assert intake.admit(EXCHANGE, encode(transmission(1, 0.0, 0, 0, None))) is not None


def test_credits_may_skip_steps() -> None:
    intake = Intake({})
    assert intake.admit(keys.credit("plant"), encode(Credit(steps_recorded=4))) == Credit(steps_recorded=4)
    assert intake.admit(keys.credit("plant"), encode(Credit(steps_recorded=9))) == Credit(steps_recorded=9)
