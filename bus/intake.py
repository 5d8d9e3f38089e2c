"""What a process lets in: every message is checked before a program sees it, and refusals are counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import msgspec

from bus.messages import Credit, Message, decoder, message_type

_CREDIT = "/credit"
_DECODERS: dict[type[Any], msgspec.json.Decoder[Any]] = {}


def _decoder_of(topic: str) -> msgspec.json.Decoder[Any]:
    kind = Credit if topic.endswith(_CREDIT) else message_type(topic)
    if kind not in _DECODERS:
        _DECODERS[kind] = decoder(kind)
    return _DECODERS[kind]


class Intake:
    """Decodes payloads and admits of every topic exactly the next slot.

    Malformed, duplicate, stale and premature messages are refused and counted by topic in `rejected`.
    ``rounds`` gives the slots in a step of topics that have more than one.
    """

    def __init__(self, rounds: Mapping[str, int]) -> None:
        self._rounds = rounds
        self._slots: dict[str, int] = {}
        self.rejected: Counter[str] = Counter()

    def admit(self, topic: str, payload: bytes) -> Any | None:
        """Return the message, or None when it is refused."""
        try:
            message = _decoder_of(topic).decode(payload)
        except (msgspec.MsgspecError, UnicodeDecodeError, KeyError):
            self.rejected[topic] += 1
            return None
        if isinstance(message, Message):
            rounds = self._rounds.get(topic, 1)
            slot = self._slots.get(topic, 0)
            if message.step * rounds + getattr(message, "round", 0) != slot:
                self.rejected[topic] += 1
                return None
            self._slots[topic] = slot + 1
        return message
