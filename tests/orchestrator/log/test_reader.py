from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import Writer

from bus.messages import Estimate, Message, Truth, decoder, message_type
from orchestrator.log.errors import LogError
from orchestrator.log.reader import Log, read_log
from orchestrator.log.writer import CHUNK_STEPS

many = settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
place = st.floats(0, 1, exclude_max=True)


def read_all(path: Path) -> tuple[Log, list[tuple[str, Message]]]:
    log = read_log(path)
    return log, list(log.records())


@pytest.fixture(scope="module")
def records(long_log: Path) -> list[tuple[str, Message]]:
    return read_all(long_log)[1]


def test_a_log_returns_what_was_recorded(log_path: Path, traffic: list[Any]) -> None:
    log, records = read_all(log_path)
    assert records == [(t, decoder(message_type(t)).decode(payload)) for t, _, _, payload in traffic]
    assert isinstance(records[0][1], Truth)
    assert isinstance(records[-1][1], Estimate)
    assert log.complete
    assert not log.truncated
    assert (log.provenance["name"], log.provenance["seed"]) == ("ring", "7")
    assert (log.topology, log.score) == ({"name": "ring"}, {"rmse": 0.5})


def test_a_log_can_be_read_twice(log_path: Path) -> None:
    log = read_log(log_path)
    assert list(log.records()) == list(log.records())


def test_an_aborted_run_is_neither_complete_nor_truncated(ring: Any, tmp_path: Path) -> None:
    plan = ring.plan()
    log = read_log(ring.write(tmp_path / "run.mcap", plan, ring.traffic(plan)[:40]))
    assert (log.complete, log.truncated) == (False, False)
    assert log.outcome["steps_recorded"] == "1"
    assert len(list(log.records())) == 40


def first_chunk(path: Path) -> int:
    return read_log(path).layout.of(Opcode.CHUNK)[0].offset


@many
@given(place)
@example(0.0)
@example(1 - 1e-9)
def test_a_log_cut_at_any_byte_yields_the_whole_chunks_before_the_cut(
    long_log: Path, records: list[Any], tmp_path: Path, where: float
) -> None:
    whole = long_log.read_bytes()
    begin = first_chunk(long_log) - 9
    cut = begin + int(where * (len(whole) - begin))
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[:cut])
    log, found = read_all(path)
    assert log.truncated
    assert not log.complete
    assert found == records[: len(found)]
    chunks = [part for part in read_log(long_log).layout.of(Opcode.CHUNK) if part.offset + part.length <= cut]
    per_step = int(log.provenance["messages_per_step"])
    steps = (0, CHUNK_STEPS, 2 * CHUNK_STEPS, 5 * CHUNK_STEPS // 2)
    assert len(found) == per_step * steps[len(chunks)]


def test_a_log_cut_before_its_first_message_says_that_nothing_is_in_it(
    long_log: Path, tmp_path: Path
) -> None:
    whole = long_log.read_bytes()
    for cut in range(1, first_chunk(long_log) - 9):
        (tmp_path / "cut.mcap").write_bytes(whole[:cut])
        with pytest.raises(LogError, match="was cut off before its first message; nothing can be saved"):
            read_log(tmp_path / "cut.mcap")


@many
@given(place, st.integers(1, 255))
def test_a_damaged_log_is_refused_or_yields_a_true_beginning(
    long_log: Path, records: list[Any], tmp_path: Path, where: float, flip: int
) -> None:
    damaged = bytearray(long_log.read_bytes())
    damaged[int(where * len(damaged))] ^= flip
    path = tmp_path / "damaged.mcap"
    path.write_bytes(damaged)
    try:
        log, found = read_all(path)
    except LogError:
        return
    assert found == records[: len(found)]
    assert log.truncated or found == records
    assert log.provenance == read_log(long_log).provenance
    assert log.topology == read_log(long_log).topology


def test_a_damaged_chunk_is_named_with_the_cure(long_log: Path, tmp_path: Path) -> None:
    damaged = bytearray(long_log.read_bytes())
    part = read_log(long_log).layout.of(Opcode.CHUNK)[1]
    damaged[part.offset + part.length // 2] ^= 1
    (tmp_path / "damaged.mcap").write_bytes(damaged)
    with pytest.raises(LogError, match=r"is damaged at or after byte .* `gauntlet log recover "):
        read_log(tmp_path / "damaged.mcap")
    with pytest.raises(LogError, match="is damaged"):
        list(read_log(tmp_path / "damaged.mcap", check=False).records())


def test_a_cut_log_with_another_seed_written_into_it_is_refused(long_log: Path, tmp_path: Path) -> None:
    forged = long_log.read_bytes()[:-100].replace(b"seed\x01\x00\x00\x007", b"seed\x01\x00\x00\x008", 1)
    (tmp_path / "forged.mcap").write_bytes(forged)
    with pytest.raises(LogError, match="is damaged where it says what was run"):
        read_log(tmp_path / "forged.mcap", check=False)


@pytest.mark.parametrize("content", [b"", b"PNG", b"name: a topology\n" * 100])
def test_a_file_of_another_kind_is_told(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "foreign").write_bytes(content)
    with pytest.raises(LogError, match="foreign is not an MCAP file; give a log that"):
        read_log(tmp_path / "foreign")


def foreign_logs(path: Path) -> Iterator[Writer]:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        yield writer
        writer.finish()


def test_an_mcap_file_of_somebody_else_is_told(tmp_path: Path) -> None:
    for writer in foreign_logs(tmp_path / "robot.mcap"):
        writer.add_metadata("robot", {"name": "r2"})
    with pytest.raises(
        LogError, match=r"robot.mcap does not say what was run; it is not a log of gauntlet's"
    ):
        read_log(tmp_path / "robot.mcap")


def test_a_missing_file_and_a_folder_are_told(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot be read: No such file"):
        read_log(tmp_path / "nothing.mcap")
    with pytest.raises(LogError, match="cannot be read: Is a directory"):
        read_log(tmp_path)


def test_a_message_of_another_version_is_told_with_its_topic_and_step(ring: Any, tmp_path: Path) -> None:
    plan = ring.plan(rounds=0)
    with ring.writer(tmp_path / "run.mcap", plan) as writer:
        writer.write_step(3, [("truth/plant", b'{"step":3,"t":0.15,"position":[1]}')])
        writer.finish({"complete": "false"})
    with pytest.raises(
        LogError, match=r"truth/plant of step 3 is not understood.*read the log with gauntlet"
    ):
        list(read_log(tmp_path / "run.mcap").records())
