"""What a process lets in: every message is checked before a program sees it, and refusals are counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import msgspec

from bus.messages import Credit, Message, decoder, message_type

_CREDIT = "/credit"
_DECODERS: dict[type[Any], msgspec.json.Decoder[Any]] = {}


def _decoder_of(kind: type[Any]) -> msgspec.json.Decoder[Any]:
    if kind not in _DECODERS:
        _DECODERS[kind] = decoder(kind)
    return _DECODERS[kind]


class Turnstile:
    """Decodes the payloads of one topic and lets in exactly its next slot, or any credit.

    All that depends on the topic is looked up when it is made, because `admit` stands in the way of
    every message of a run. Raises KeyError for a topic that carries no message.
    """

    def __init__(self, topic: str, rounds: int, rejected: Counter[str]) -> None:
        kind: type[Any] = Credit if topic.endswith(_CREDIT) else message_type(topic)
        self._topic = topic
        self._decode = _decoder_of(kind).decode
        self._has_slots = issubclass(kind, Message)
        self._has_rounds = "round" in kind.__struct_fields__
        self._rounds = rounds
        self._step = self._round = 0
        self._rejected = rejected

    def admit(self, payload: bytes) -> Any | None:
        """Return the message, or None when it is refused."""
        try:
            message = self._decode(payload)
        except (msgspec.MsgspecError, UnicodeDecodeError):
            self._rejected[self._topic] += 1
            return None
        if self._has_slots:
            if message.step != self._step or (self._has_rounds and message.round != self._round):
                self._rejected[self._topic] += 1
                return None
            self._expect_next()
        return message

    def _expect_next(self) -> None:
        self._round += 1
        if self._round >= self._rounds:
            self._round = 0
            self._step += 1


class Intake:
    """The turnstiles of a process: of every topic exactly the next slot is let in.

    Malformed, duplicate, stale and premature messages are refused and counted by topic in `rejected`.
    ``rounds`` gives the slots in a step of topics that have more than one.
    """

    def __init__(self, rounds: Mapping[str, int]) -> None:
        self._rounds = rounds
        self._turnstiles: dict[str, Turnstile] = {}
        self.rejected: Counter[str] = Counter()

    def turnstile(self, topic: str) -> Turnstile:
        """Return the turnstile of a topic; raises KeyError for a topic that carries no message."""
        if topic not in self._turnstiles:
            self._turnstiles[topic] = Turnstile(topic, self._rounds.get(topic, 1), self.rejected)
        return self._turnstiles[topic]

    def admit(self, topic: str, payload: bytes) -> Any | None:
        """Return the message, or None when it is refused."""
        turnstile = self._turnstiles.get(topic)
        if turnstile is None:
            try:
                turnstile = self.turnstile(topic)
            except KeyError:
                self.rejected[topic] += 1
                return None
        return turnstile.admit(payload)
