from __future__ import annotations

from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader

from orchestrator.log.errors import LogError
from orchestrator.log.reader import read_log
from orchestrator.log.recover import recover
from orchestrator.log.writer import CHUNK_STEPS

CHUNK = 11 * CHUNK_STEPS
"""The messages of a whole chunk of the long log: 11 a step."""


def cut(path: Path, out: Path, end: int) -> Path:
    out.write_bytes(path.read_bytes()[:end])
    return out


def end_of_chunk(path: Path, number: int) -> int:
    part = read_log(path).layout.of(Opcode.CHUNK)[number]
    return part.offset + part.length


def test_a_cut_log_becomes_a_whole_file_with_the_same_beginning(long_log: Path, tmp_path: Path) -> None:
    damaged = cut(long_log, tmp_path / "run.mcap", end_of_chunk(long_log, 1) + 5)
    recovery = recover(damaged)
    assert recovery == (tmp_path / "run.recovered.mcap", 2 * CHUNK, 2 * CHUNK_STEPS, 0)
    log = read_log(recovery.path)
    assert not log.truncated
    assert log.outcome["complete"] == "false"
    assert list(log.records()) == list(read_log(damaged).records())
    assert (log.provenance, log.topology_json) == (
        read_log(long_log).provenance,
        read_log(long_log).topology_json,
    )


def test_the_recovered_file_opens_in_the_library_with_its_summary(long_log: Path, tmp_path: Path) -> None:
    recovery = recover(cut(long_log, tmp_path / "run.mcap", end_of_chunk(long_log, 0)))
    with recovery.path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(list(reader.iter_messages())) == CHUNK


def test_a_log_that_lost_only_its_end_mark_keeps_its_score_and_is_complete(
    long_log: Path, tmp_path: Path
) -> None:
    recovery = recover(cut(long_log, tmp_path / "run.mcap", long_log.stat().st_size - 1))
    log = read_log(recovery.path)
    assert log.complete
    assert log.score == {"rmse": 0.5}
    assert log.outcome["recovered"] == "true"


def test_chunks_are_the_same_bytes_after_recovery(long_log: Path, tmp_path: Path) -> None:
    recovery = recover(cut(long_log, tmp_path / "run.mcap", end_of_chunk(long_log, 2)))
    end = end_of_chunk(long_log, 2)
    assert recovery.path.read_bytes()[:end] == long_log.read_bytes()[:end]


def test_damaged_chunks_are_left_out_and_counted_and_the_score_is_gone(
    long_log: Path, tmp_path: Path
) -> None:
    content = bytearray(long_log.read_bytes())
    content[end_of_chunk(long_log, 1) - 10] ^= 1
    (tmp_path / "run.mcap").write_bytes(content)
    recovery = recover(tmp_path / "run.mcap")
    assert recovery[1:] == (3 * CHUNK // 2, CHUNK_STEPS, 1)
    log = read_log(recovery.path)
    steps = sorted({message.step for _, message in log.records()})
    assert steps == [*range(CHUNK_STEPS), *range(2 * CHUNK_STEPS, 5 * CHUNK_STEPS // 2)]
    assert (log.score, log.complete) == (None, False)
    assert log.outcome["damaged_chunks"] == "1"


def test_a_log_without_its_first_chunk_has_its_topics_from_the_summary(
    long_log: Path, tmp_path: Path
) -> None:
    content = bytearray(long_log.read_bytes())
    content[end_of_chunk(long_log, 0) - 10] ^= 1
    (tmp_path / "run.mcap").write_bytes(content)
    assert recover(tmp_path / "run.mcap").messages == 3 * CHUNK // 2


def test_a_whole_log_is_left_alone(long_log: Path, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="is whole; there is nothing to recover"):
        recover(long_log, tmp_path / "out.mcap")
    assert not list(tmp_path.iterdir())


def test_an_existing_file_is_not_overwritten(long_log: Path, tmp_path: Path) -> None:
    damaged = cut(long_log, tmp_path / "run.mcap", end_of_chunk(long_log, 1))
    out = tmp_path / "precious.mcap"
    out.write_bytes(b"precious")
    with pytest.raises(LogError, match="exists already"):
        recover(damaged, out)
    assert out.read_bytes() == b"precious"
