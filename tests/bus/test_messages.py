"""The rules that log viewers impose on schemas, and what the encoding promises."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.messages import TOPIC_TYPES, Message, Truth, decoder, encode, message_type, schema

SCALARS = {"integer", "number", "string", "boolean"}
finite = st.floats(allow_nan=False, allow_infinity=False)


@pytest.mark.parametrize("message", TOPIC_TYPES.values())
def test_a_schema_is_flat_as_viewers_need_it(message: type[Message]) -> None:
    body = schema(message)
    assert (body["type"], body["title"]) == ("object", message.__name__)
    assert not {"$ref", "$defs", "anyOf", "oneOf", "allOf"} & body.keys()
    for name, field in body["properties"].items():
        kind = field["type"]
        if kind == "array":
            kind, field = field["items"]["type"], field["items"]
        assert kind in SCALARS, f"{message.__name__}.{name} is a {kind}"
        assert not {"$ref", "anyOf", "oneOf", "allOf", "items"} & field.keys()


@pytest.mark.parametrize("message", TOPIC_TYPES.values())
def test_a_schema_names_every_field_and_requires_it(message: type[Message]) -> None:
    body = schema(message)
    assert list(body["properties"]) == list(message.__struct_fields__)
    assert body["required"] == list(message.__struct_fields__)


@pytest.mark.parametrize("message", TOPIC_TYPES.values())
def test_a_description_is_clean_text(message: type[Message]) -> None:
    lines = schema(message)["description"].splitlines()
    assert lines
    assert not any(line.startswith(" ") for line in lines)


@given(st.lists(finite), st.integers(0, 2**53))
def test_text_loses_no_bit(state: list[float], step: int) -> None:
    message = Truth(step=step, t=step * 0.05, state=state)
    again = decoder(Truth).decode(encode(message))
    assert list(map(float.hex, again.state)) == list(map(float.hex, state))
    assert again == message


@pytest.mark.parametrize(
    "payload", [b"", b"{}", b'{"step":1,"t":0.1}', b'{"step":1.5,"t":0.1,"state":[]}', b"[1]", b"\xff"]
)
def test_what_is_no_message_is_refused(payload: bytes) -> None:
    with pytest.raises((msgspec.DecodeError, UnicodeDecodeError)):
        decoder(Truth).decode(payload)


def test_topics_tell_their_message_type() -> None:
    topics: dict[str, Any] = {f"{kind}/a/b": message for kind, message in TOPIC_TYPES.items()}
    assert {topic: message_type(topic) for topic in topics} == topics
    with pytest.raises(KeyError):
        message_type("control/credit")
