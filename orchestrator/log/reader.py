"""Reads a run's log: what was run, how far it came, and its messages in the order of the file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import msgspec
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata

from bus.messages import Message, decoder, message_type
from orchestrator.log.errors import LogError
from orchestrator.log.provenance import unsealed
from orchestrator.log.recorder import departures
from orchestrator.log.scan import Layout, check_crcs, read_chunk, read_part, scan
from orchestrator.log.writer import OUTCOME, PROVENANCE, SCORE, TOPOLOGY


class Payload(NamedTuple):
    """A message as the log holds it: its topic, its step, its JSON."""

    topic: str
    step: int
    json: bytes


@dataclass(frozen=True)
class Log:
    """A log, opened: its facts at hand, its messages read from the file when they are asked for.

    ``truncated`` tells that the file was cut off: it holds a beginning of the run.
    """

    path: Path
    provenance: dict[str, str]
    outcome: dict[str, str]
    """What the recorder said at the end; empty when the file was cut off before."""
    topology_json: bytes
    score_json: bytes | None
    truncated: bool
    layout: Layout

    @property
    def complete(self) -> bool:
        """Whether the log holds every message of every step of its plan."""
        return not self.truncated and self.outcome.get("complete") == "true"

    @property
    def departed(self) -> dict[str, int]:
        """The first silent step of each node that died though no plan had it so."""
        return departures(self.outcome)

    @cached_property
    def topology(self) -> dict[str, Any]:
        """The resolved topology, as the orchestrator wrote it."""
        topology: dict[str, Any] = msgspec.json.decode(self.topology_json)
        return topology

    @cached_property
    def score(self) -> dict[str, Any] | None:
        """The score that was attached at the end, if there is one."""
        return None if self.score_json is None else msgspec.json.decode(self.score_json)

    def payloads(self, on_damage: Callable[[LogError], None] | None = None) -> Iterator[Payload]:
        """Yield every message undecoded, in the order of the file.

        A damaged chunk raises LogError, or, when ``on_damage`` is given, is told to it and skipped.
        """
        with self.path.open("rb") as stream:
            topics = _topics(stream, self.layout)
            for part in self.layout.of(Opcode.CHUNK):
                try:
                    messages = read_chunk(stream, part).messages
                except LogError as error:
                    if on_damage is None:
                        raise
                    on_damage(error)
                    continue
                for channel, step, payload in messages:
                    yield Payload(topics[channel], step, payload)

    def steps(
        self, on_damage: Callable[[LogError], None] | None = None
    ) -> Iterator[tuple[int, list[Payload]]]:
        """Yield every step with its messages undecoded; ``on_damage`` as in `payloads`."""
        for step, held in groupby(self.payloads(on_damage), key=lambda payload: payload.step):
            yield step, list(held)

    def topics(self) -> dict[int, str]:
        """Return every topic of the run by its channel number, in the order in which they were registered."""
        with self.path.open("rb") as stream:
            return _topics(stream, self.layout)

    def counts(self) -> tuple[Counter[str], int]:
        """Return how many messages each topic holds, and how many steps from the first on are whole."""
        per_step = int(self.provenance["messages_per_step"])
        topics: Counter[str] = Counter(dict.fromkeys(self.topics().values(), 0))
        whole_steps = 0
        for step, held in self.steps():
            topics.update(payload.topic for payload in held)
            whole_steps += step == whole_steps and len(held) == per_step
        return topics, whole_steps

    def records(self) -> Iterator[tuple[str, Message]]:
        """Yield every (topic, message) in the order of the file; raises LogError for one not understood."""
        decoders: dict[str, msgspec.json.Decoder[Message]] = {}
        for topic, step, payload in self.payloads():
            try:
                if topic not in decoders:
                    decoders[topic] = decoder(message_type(topic))
                yield topic, decoders[topic].decode(payload)
            except (KeyError, msgspec.DecodeError) as error:
                written_by = self.provenance.get("version.gauntlet", "an unknown version")
                raise LogError(
                    f"{self.path}: {topic} of step {step} is not understood by this version ({error}); "
                    f"read the log with gauntlet {written_by}, which wrote it"
                ) from error


def _topics(stream: BinaryIO, layout: Layout) -> dict[int, str]:
    """Return the topics by channel number: from the first chunk, or if that is damaged, from the summary."""
    chunks = layout.of(Opcode.CHUNK)
    try:
        return read_chunk(stream, chunks[0]).topics if chunks else {}
    except LogError:
        if not layout.whole:
            raise
        check_crcs(stream, layout, data=False)
        channels = [read_part(stream, part, Channel.read) for part in layout.of(Opcode.CHANNEL)]
    return {channel.id: channel.topic for channel in channels}


def _facts(stream: BinaryIO, layout: Layout) -> tuple[dict[str, dict[str, str]], dict[str, bytes]]:
    """Return the metadata records and the attachments of a file by name."""
    metadata = [read_part(stream, part, Metadata.read) for part in layout.of(Opcode.METADATA)]
    attachments = [read_part(stream, part, Attachment.read) for part in layout.of(Opcode.ATTACHMENT)]
    return (
        {record.name: record.metadata for record in metadata},
        {attachment.name: attachment.data for attachment in attachments},
    )


def read_log(path: Path, *, check: bool = True) -> Log:
    """Open a log, whole or cut off; raises LogError for a file that is none of ours, or damaged.

    ``check`` compares the check sum over all data, so that the facts at the beginning can be trusted too.
    """
    try:
        with path.open("rb") as stream:
            layout = scan(stream)
            if check:
                check_crcs(stream, layout)
            metadata, attachments = _facts(stream, layout)
    except OSError as error:
        raise LogError(f"{path} cannot be read: {error.strerror}; check its name and rights") from error
    if TOPOLOGY not in attachments or PROVENANCE not in metadata:
        raise LogError(
            f"{path} does not say what was run; it is not a log of gauntlet's"
            if layout.whole
            else f"{path} was cut off before its first message; nothing can be saved, run it again"
        )
    provenance = unsealed(metadata[PROVENANCE])
    if provenance is None:
        raise LogError(f"{path} is damaged where it says what was run; nothing can be saved, run it again")
    return Log(
        path=path,
        provenance=provenance,
        outcome=metadata.get(OUTCOME, {}),
        topology_json=attachments[TOPOLOGY],
        score_json=attachments.get(SCORE),
        truncated=not layout.whole,
        layout=layout,
    )
