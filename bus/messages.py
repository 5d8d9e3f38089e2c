"""The messages, and their one JSON encoding for the wire and the log.

Rules that log viewers impose: flat fields only, a matrix as a row-major list beside its shape, no null
unions, no integer above 2**53, no NaN or infinity. Numbers are written as shortest round-trip decimals: text
loses no bit.
"""

from __future__ import annotations

import inspect
from typing import Any, TypeVar

import msgspec


class Message(msgspec.Struct, frozen=True, kw_only=True):
    """What every message carries: the integer step and its simulated time ``t = step * period`` (s)."""

    step: int
    t: float


class Truth(Message, frozen=True, kw_only=True):
    """The plant's true state at a step, ``state`` (n,).

    ``control`` is the input (p,) that was applied on the way into this step, and ``attack`` the value of the
    signal attack that enters this step; empty when there is none.
    """

    state: list[float]
    control: list[float] = []
    attack: list[float] = []


class Transmission(Message, frozen=True, kw_only=True):
    """One sender's slot: zero, one or many packets, the same for all the links that leave it.

    ``sequence`` numbers the packets of the stream; packet i owns ``values[offset[i]:offset[i + 1]]``, the
    last one the rest. ``round`` counts the exchange rounds inside a step (0 for measurements). Empty lists
    are a quiet slot. ``check`` holds the seal of each packet when the sender seals its packets, else nothing.
    """

    round: int
    sequence: list[int]
    offset: list[int]
    values: list[float]
    check: list[int] = []


class Inbox(Message, frozen=True, kw_only=True):
    """All packets that reach one receiver in one phase of a step, as parallel lists, a packet an entry.

    ``source`` sent the packet in step ``sent_step`` as number ``sequence`` of its stream; ``kind`` names the
    stream and with it the layout of ``values``. Packet i owns ``values[offset[i]:offset[i + 1]]``. ``check``
    holds the seals of the packets when one of them has a seal, else nothing.
    """

    round: int
    source: list[str]
    sent_step: list[int]
    sequence: list[int]
    kind: list[str]
    offset: list[int]
    values: list[float]
    check: list[int] = []


class Estimate(Message, frozen=True, kw_only=True):
    """An estimator's belief about the state at step ``refers_to``.

    ``state`` (n,), ``covariance`` row-major with ``covariance_shape`` [n, n], ``sigma`` (n,) the square roots
    of its diagonal. A diverged estimator sets ``diverged`` and leaves the lists empty. ``nis`` is the
    normalised innovation squared of this step's packets with ``nis_dof`` degrees of freedom (0: no packet).
    Entry i of the ``detector_*`` lists is the verdict on one packet: its source, test statistic, and whether
    it raised the alarm. ``refused`` counts the packets of this step that never reached the mathematics,
    because their seal did not fit or the node does not listen to their source.
    """

    refers_to: int
    diverged: bool
    state: list[float]
    covariance: list[float]
    covariance_shape: list[int]
    sigma: list[float]
    nis: float
    nis_dof: int
    detector_source: list[str]
    detector_sequence: list[int]
    detector_statistic: list[float]
    detector_alarm: list[bool]
    diagnostic_name: list[str]
    diagnostic_value: list[float]
    refused: int = 0


class ChannelEvents(Message, frozen=True, kw_only=True):
    """What the channel did in one phase of a step; the ground truth that scores the detectors.

    Entry i of ``link``, ``sent``, ``lost``, ``attacked``, ``delivered`` accounts for the packets of one link;
    so do ``injected``, ``duplicated``, ``refused`` (delivered, and sure to fail the receiver's check) and
    ``in_flight`` (kept for later slots), which are empty when they are zero on every link. Over all slots so
    far, sent + injected + duplicated = delivered + lost + refused + in_flight.

    The ``event_*`` lists hold one entry for each thing a stage did: on which link, by which stage, to which
    packet, what (an action of `channel.contract`), and by how much (its magnitude there).
    """

    round: int
    link: list[str]
    sent: list[int]
    lost: list[int]
    attacked: list[int]
    delivered: list[int]
    injected: list[int] = []
    duplicated: list[int] = []
    refused: list[int] = []
    in_flight: list[int] = []
    event_link: list[str]
    event_stage: list[str]
    event_sequence: list[int]
    event_action: list[str]
    event_magnitude: list[float]


class Credit(msgspec.Struct, frozen=True, kw_only=True):
    """The recorder's word to the plant: every message of all steps before ``steps_recorded`` is stored."""

    steps_recorded: int


class Finished(msgspec.Struct, frozen=True, kw_only=True):
    """A process's last words: wall-clock facts (s, bytes) that stand beside the log, never in it."""

    cpu_s: float
    peak_memory_bytes: int
    rejected: dict[str, int]


TOPIC_TYPES: dict[str, type[Message]] = {
    "truth": Truth,
    "tx": Transmission,
    "rx": Inbox,
    "estimate": Estimate,
    "channel": ChannelEvents,
}

M = TypeVar("M")

_encoder = msgspec.json.Encoder()


def message_type(topic: str) -> type[Message]:
    """Return the message type that a topic carries; raises KeyError for a topic that no log holds."""
    return TOPIC_TYPES[topic.partition("/")[0]]


def encode(message: msgspec.Struct) -> bytes:
    """Return the JSON of a message; the caller guarantees that every number is finite."""
    return _encoder.encode(message)


def decoder(message: type[M]) -> msgspec.json.Decoder[M]:
    """Return a decoder that checks field names and types; decoding raises `msgspec.ValidationError`."""
    return msgspec.json.Decoder(message)


def schema(message: type[Message]) -> dict[str, Any]:
    """Return the flat JSON Schema of a message type: no references, no unions, as viewers need it."""
    (_,), components = msgspec.json.schema_components([message], ref_template="{name}")
    body = components[message.__name__]
    properties = {name: _undefaulted(field) for name, field in body["properties"].items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **body,
        "description": inspect.cleandoc(body.get("description", "")),
        "properties": properties,
        "required": list(properties),  # a sender may leave a default out, the log always holds it
    }


def _undefaulted(field: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in field.items() if key != "default"}
