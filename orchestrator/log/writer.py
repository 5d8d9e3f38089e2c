"""The MCAP file of a run: provenance first, then whole steps in chunks, then the outcome and the score.

A thin layer over the library's writer. Chunks close by size and by step, never by the clock: the bytes of the
file are a function of what is written alone. Each chunk is handed to the operating system as it closes.
"""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import TracebackType

import msgspec
from mcap.writer import CompressionType, Writer

from bus.messages import Message, message_type, schema
from orchestrator.log.errors import LogError
from orchestrator.log.provenance import sealed

LIBRARY = "gauntlet"
PROVENANCE = "gauntlet"
"""The metadata record at the start: what was run, with what."""
OUTCOME = "gauntlet.outcome"
"""The metadata record at the end: how much of it came to be recorded."""
TOPOLOGY = "topology.json"
SCORE = "score.json"
CHUNK_BYTES = 256 * 1024
CHUNK_STEPS = 10
_RECORD_OVERHEAD_BYTES = 31
_MEDIA_TYPE = "application/json"


@cache
def _schema_json(message: type[Message]) -> bytes:
    return msgspec.json.encode(schema(message))


class LogWriter:
    """Writes a new log; use it as a context manager, and `finish` it.

    ``provenance`` are the facts of the experiment and must hold ``period_s``; ``topology`` is the resolved
    topology's JSON; ``topics`` are registered in the order given. A log left without `finish` is readable up
    to its last flushed chunk.
    """

    def __init__(
        self, path: Path, provenance: Mapping[str, str], topology: bytes, topics: Sequence[str]
    ) -> None:
        self.path = path
        self._period_s = float(provenance["period_s"])
        self._pending_bytes = 0
        self._steps_flushed = 0
        self._next_step = 0
        self._failure: LogError | None = None
        try:
            self._stream = path.open("xb")
        except FileExistsError:
            raise LogError(f"{path} exists already; remove it or write to another path") from None
        except OSError as error:
            raise LogError(f"{path} cannot be written: {error.strerror}; choose another path") from None
        self._mcap = Writer(
            self._stream, chunk_size=2 * CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._to_disk(lambda: self._begin(provenance, topology))
        self._channels = self._register(topics)

    def __enter__(self) -> LogWriter:
        """Return the writer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file; without `finish` it stays readable up to its last chunk."""
        self._stream.raw.close()

    def _begin(self, provenance: Mapping[str, str], topology: bytes) -> None:
        self._mcap.start(profile="", library=LIBRARY)
        self._mcap.add_metadata(PROVENANCE, sealed(provenance))
        self._mcap.add_attachment(0, 0, TOPOLOGY, _MEDIA_TYPE, topology)
        self._stream.flush()

    def _register(self, topics: Sequence[str]) -> dict[str, int]:
        """Register schemas and channels, in the order given; they stand at the start of the first chunk."""
        schemas: dict[type[Message], int] = {}
        channels: dict[str, int] = {}
        for topic in topics:
            message = message_type(topic)
            if message not in schemas:
                body = _schema_json(message)
                schemas[message] = self._mcap.register_schema(message.__name__, "jsonschema", body)
                self._pending_bytes += _RECORD_OVERHEAD_BYTES + len(message.__name__) + len(body)
            channels[topic] = self._mcap.register_channel(topic, "json", schemas[message])
            self._pending_bytes += _RECORD_OVERHEAD_BYTES + len(topic)
        return channels

    def write_step(self, step: int, messages: Iterable[tuple[str, bytes]]) -> None:
        """Write a step's (topic, payload) in the order given; steps come in rising order."""
        self._to_disk(lambda: self._write_step(step, messages))

    def _write_step(self, step: int, messages: Iterable[tuple[str, bytes]]) -> None:
        time_ns = round(step * self._period_s * 1e9)
        add_message = self._mcap.add_message
        channels = self._channels
        for topic, payload in messages:
            size = len(payload) + _RECORD_OVERHEAD_BYTES
            if self._pending_bytes + size > CHUNK_BYTES:
                self._flush()
            self._pending_bytes += size
            add_message(channels[topic], time_ns, payload, time_ns, step)
        self._next_step = step + 1
        if self._next_step % CHUNK_STEPS == 0:
            self._flush()

    def _flush(self) -> None:
        self._mcap.flush()  # type: ignore[no-untyped-call]
        self._pending_bytes = 0
        self._steps_flushed = self._next_step

    def flush(self) -> None:
        """Close the open chunk and hand it to the operating system: a reader sees all steps so far."""
        self._to_disk(self._flush)

    def finish(self, outcome: Mapping[str, str], score: bytes | None = None) -> None:
        """Write the outcome, the score's JSON if there is one, and the summary; close the file."""
        self._to_disk(lambda: self._finish(outcome, score))

    def _finish(self, outcome: Mapping[str, str], score: bytes | None) -> None:
        self._flush()
        self._mcap.add_metadata(OUTCOME, dict(sorted(outcome.items())))
        if score is not None:
            self._mcap.add_attachment(0, 0, SCORE, _MEDIA_TYPE, score)
        self._mcap.finish()  # type: ignore[no-untyped-call]
        self._stream.close()

    def _to_disk(self, write: Callable[[], None]) -> None:
        """Write; once the system has refused, leave the file as it is and raise LogError with the cure."""
        if self._failure is not None:
            raise self._failure
        try:
            write()
        except OSError as error:
            self._stream.raw.close()
            self._failure = self._explain(error)
            raise self._failure from error

    def _explain(self, error: OSError) -> LogError:
        full = error.errno in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
        cure = "free some space or write to another disk" if full else "write to another disk"
        held = f"at least the steps before {self._steps_flushed}" if self._steps_flushed else "no whole step"
        return LogError(
            f"{self.path} cannot be written: {error.strerror}; it holds {held}; {cure}, then run again"
        )
