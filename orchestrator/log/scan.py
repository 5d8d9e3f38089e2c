"""Finds the records of an MCAP file, whole or cut off at any byte, and reads what lies in them.

Only the outermost frame of the format is read here (magic, then opcode, length, body); what is in a body the
library reads. A file that was cut is read up to its last whole record.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from shlex import quote
from typing import BinaryIO, NamedTuple, TypeVar

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from orchestrator.log.errors import LogError

_HEAD = struct.Struct("<BQ")
_CRC = struct.Struct("<I")
_MESSAGE = struct.Struct("<HI16x")  # channel, sequence; both times are skipped
_BLOCK_BYTES = 1 << 20
_KEPT = frozenset(
    {
        Opcode.METADATA,
        Opcode.ATTACHMENT,
        Opcode.CHUNK,
        Opcode.DATA_END,
        Opcode.CHANNEL,
        Opcode.STATISTICS,
        Opcode.FOOTER,
    }
)

R = TypeVar("R", bound=McapRecord)


class Part(NamedTuple):
    """Where a record lies in the file: its opcode, the offset of its body, and the body's length."""

    opcode: int
    offset: int
    length: int


@dataclass(frozen=True)
class Layout:
    """The records worth knowing of a file, and whether it reaches to its end mark."""

    parts: tuple[Part, ...]
    whole: bool

    def of(self, opcode: Opcode) -> tuple[Part, ...]:
        """Return the records of one kind, in file order."""
        return tuple(part for part in self.parts if part.opcode == opcode)


class ChunkContent(NamedTuple):
    """The topics that a chunk registers, by channel number, and its messages: (channel, step, payload)."""

    topics: dict[int, str]
    messages: list[tuple[int, int, bytes]]


def scan(stream: BinaryIO) -> Layout:
    """Return where the records lie; raises LogError when this is no MCAP file."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(0)
    magic = stream.read(len(MCAP0_MAGIC))
    if not magic or not MCAP0_MAGIC.startswith(magic):
        raise LogError(f"{stream.name} is not an MCAP file; give a log that `gauntlet run` wrote")
    parts: list[Part] = []
    begin = len(MCAP0_MAGIC)
    while begin + _HEAD.size <= size:
        stream.seek(begin)
        opcode, length = _HEAD.unpack(stream.read(_HEAD.size))
        body = begin + _HEAD.size
        begin = body + length
        if begin > size:
            break
        if opcode in _KEPT:
            parts.append(Part(opcode, body, length))
        if opcode == Opcode.FOOTER:
            stream.seek(begin)
            return Layout(tuple(parts), whole=stream.read() == MCAP0_MAGIC)
    return Layout(tuple(parts), whole=False)


def read_part(stream: BinaryIO, part: Part, read: Callable[[ReadDataStream], R]) -> R:
    """Read a record with the library; raises LogError when its body makes no sense."""
    stream.seek(part.offset)
    body = stream.read(part.length)
    if part.opcode == Opcode.ATTACHMENT and zlib.crc32(body[:-4]) != _CRC.unpack(body[-4:])[0]:
        raise _damage(stream, part.offset)
    try:
        return read(ReadDataStream(BytesIO(body)))
    except (McapError, struct.error, ValueError) as error:
        raise _damage(stream, part.offset) from error


def read_chunk(stream: BinaryIO, part: Part) -> ChunkContent:
    """Return what a chunk holds; raises LogError when its check sum or its content is wrong."""
    chunk = read_part(stream, part, Chunk.read)
    try:
        plain, length = get_chunk_data_stream(chunk, validate_crc=True)
        return _chunk_content(plain.read(length))
    except (McapError, zstandard.ZstdError, struct.error, ValueError, OverflowError, MemoryError) as error:
        raise _damage(stream, part.offset) from error


def _chunk_content(data: bytes) -> ChunkContent:
    """Take a chunk apart: messages here, since they are many, the few channels with the library."""
    content = ChunkContent({}, [])
    at = 0
    while at < len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        body, at = at + _HEAD.size, at + _HEAD.size + length
        if opcode == Opcode.MESSAGE:
            channel, step = _MESSAGE.unpack_from(data, body)
            content.messages.append((channel, step, data[body + _MESSAGE.size : at]))
        elif opcode == Opcode.CHANNEL:
            record = Channel.read(ReadDataStream(BytesIO(data[body:at])))
            content.topics[record.id] = record.topic
    return content


def _damage(stream: BinaryIO, offset: int) -> LogError:
    return LogError(
        f"{stream.name} is damaged at or after byte {offset}; run it again, or save what is whole with "
        f"`gauntlet log recover {quote(stream.name)}`"
    )


def check_crcs(stream: BinaryIO, layout: Layout, *, data: bool = True) -> None:
    """Raise LogError when the check sum over the data (if asked for) or the summary is wrong; 0 is none."""
    ends = {part.opcode: part for part in layout.parts if part.opcode in {Opcode.DATA_END, Opcode.FOOTER}}
    data_end, footer = ends.get(Opcode.DATA_END), ends.get(Opcode.FOOTER)
    if data and data_end:
        _check_crc(stream, 0, data_end.offset - _HEAD.size, data_end.offset)
    if data_end and footer:
        crc = footer.offset + footer.length - _CRC.size
        _check_crc(stream, data_end.offset + data_end.length, crc, crc)


def _check_crc(stream: BinaryIO, begin: int, end: int, crc: int) -> None:
    """Compare the check sum of the bytes from ``begin`` to ``end`` with that which stands at ``crc``."""
    stream.seek(crc)
    (expected,) = _CRC.unpack(stream.read(_CRC.size))
    stream.seek(begin)
    found = 0
    for position in range(begin, end, _BLOCK_BYTES):
        found = zlib.crc32(stream.read(min(end - position, _BLOCK_BYTES)), found)
    if expected not in {0, found}:
        raise _damage(stream, begin)
