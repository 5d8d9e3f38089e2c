from __future__ import annotations

import json
import random
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from bus.messages import message_type, schema
from bus.plan import Plan
from orchestrator.log.errors import LogError
from orchestrator.log.order import canonical_order, canonical_topics
from orchestrator.log.reader import read_log
from orchestrator.log.recorder import Recorder
from orchestrator.log.writer import CHUNK_BYTES, CHUNK_STEPS


def chunks_of(path: Path) -> list[Chunk]:
    with path.open("rb") as stream:
        records = StreamReader(stream, emit_chunks=True, validate_crcs=True).records
        return [record for record in records if isinstance(record, Chunk)]


def test_the_library_alone_reads_everything_in_canonical_order(log_path: Path, plan: Plan) -> None:
    with log_path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        messages = [
            (channel.topic, message.sequence, message.log_time, message.publish_time)
            for _, channel, message in reader.iter_messages(log_time_order=False)
        ]
    assert messages == [
        (slot.topic, step, step * 50_000_000, step * 50_000_000)
        for step in range(plan.steps)
        for slot in canonical_order(plan)
    ]


def test_channels_are_registered_in_canonical_order_with_the_schema_of_their_messages(
    log_path: Path, plan: Plan
) -> None:
    with log_path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    channels = list(summary.channels.values())
    assert tuple(channel.topic for channel in channels) == canonical_topics(plan)
    for channel in channels:
        expected = message_type(channel.topic)
        body = summary.schemas[channel.schema_id]
        assert (channel.message_encoding, body.encoding, body.name) == (
            "json",
            "jsonschema",
            expected.__name__,
        )
        assert json.loads(body.data) == schema(expected)


def test_every_payload_is_valid_under_the_schema_beside_it(log_path: Path) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    with log_path.open("rb") as stream:
        for body, _, message in make_reader(stream).iter_messages():
            assert body is not None
            jsonschema.validate(json.loads(message.data), json.loads(body.data))


def test_provenance_and_topology_stand_before_the_first_message_and_know_no_clock(log_path: Path) -> None:
    with log_path.open("rb") as stream:
        records = list(StreamReader(stream, emit_chunks=True).records)
        stream.seek(0)
        reader = make_reader(stream)
        attachments = list(reader.iter_attachments())
        header = reader.get_header()
    kinds = [type(record).__name__ for record in records]
    assert kinds[:4] == ["Header", "Metadata", "Attachment", "Chunk"]
    assert (header.profile, header.library) == ("", "gauntlet")
    assert [attachment.name for attachment in attachments] == ["topology.json", "score.json"]
    assert {(attachment.log_time, attachment.create_time) for attachment in attachments} == {(0, 0)}


def test_payloads_are_stored_as_they_came(log_path: Path, traffic: list[Any]) -> None:
    with log_path.open("rb") as stream:
        held = [message.data for _, _, message in make_reader(stream).iter_messages(log_time_order=False)]
    assert held == [payload for *_, payload in traffic]


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32))
def test_the_order_of_arrival_changes_no_byte(
    ring: Any, plan: Plan, traffic: list[Any], log_path: Path, tmp_path: Path, seed: int
) -> None:
    path = tmp_path / "shuffled.mcap"
    path.unlink(missing_ok=True)
    ring.write(path, plan, random.Random(seed).sample(traffic, len(traffic)))
    assert path.read_bytes() == log_path.read_bytes()


def test_simulated_time_is_rounded_and_never_accumulated(ring: Any, tmp_path: Path) -> None:
    plan = ring.plan(steps=1, rounds=0)
    with ring.writer(tmp_path / "run.mcap", plan) as writer:
        writer.write_step(123_457, [("truth/plant", b"{}")])
        writer.finish({})
    with (tmp_path / "run.mcap").open("rb") as stream:
        (message,) = [message for *_, message in make_reader(stream).iter_messages()]
    assert message.log_time == round(123_457 * 0.05 * 1e9)


def test_chunks_are_closed_by_step(long_log: Path) -> None:
    period_ns = 50_000_000
    times = [chunk.message_start_time // period_ns for chunk in chunks_of(long_log)]
    assert times == [0, CHUNK_STEPS, 2 * CHUNK_STEPS]


def test_no_chunk_is_larger_than_its_bound(ring: Any, tmp_path: Path) -> None:
    plan = ring.plan(steps=1, rounds=0)
    with ring.writer(tmp_path / "run.mcap", plan) as writer:
        for step in range(5):
            writer.write_step(step, [(topic, b" " * 30_000) for topic in canonical_topics(plan)])
        writer.finish({})
    sizes = [chunk.uncompressed_size for chunk in chunks_of(tmp_path / "run.mcap")]
    assert max(sizes) <= CHUNK_BYTES
    assert min(sizes[:-1]) > CHUNK_BYTES - 31_000


def test_what_was_flushed_is_readable_while_the_run_goes_on(ring: Any, tmp_path: Path) -> None:
    plan = ring.plan(steps=3 * CHUNK_STEPS, rounds=0)
    per_step = len(canonical_order(plan))
    stored = 2 * CHUNK_STEPS - 1
    with ring.writer(tmp_path / "run.mcap", plan) as writer:
        store_all(Recorder(plan, writer, window=1), ring.traffic(plan)[: stored * per_step])
        assert len(list(read_log(tmp_path / "run.mcap").records())) == CHUNK_STEPS * per_step
        writer.flush()
        log = read_log(tmp_path / "run.mcap")
        assert len(list(log.records())) == stored * per_step
    assert log.truncated


def test_an_existing_file_is_not_overwritten(ring: Any, plan: Plan, tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"precious")
    with pytest.raises(LogError, match="exists already"):
        ring.writer(tmp_path / "run.mcap", plan)
    assert (tmp_path / "run.mcap").read_bytes() == b"precious"


def test_a_folder_that_is_not_there_is_told(ring: Any, plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"cannot be written: No such file.*choose another path"):
        ring.writer(tmp_path / "nowhere" / "run.mcap", plan)


@contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    """Let this process write no file beyond a size: what a full disk looks like, without one."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def store_all(recorder: Recorder, traffic: list[Any]) -> None:
    for message in traffic:
        recorder.store(*message)


def test_a_full_disk_ends_the_log_with_a_cure_and_leaves_it_readable(
    ring: Any, long_log: Path, tmp_path: Path
) -> None:
    plan = ring.plan(steps=5 * CHUNK_STEPS // 2, rounds=0)
    path = tmp_path / "run.mcap"
    second = read_log(long_log).layout.of(Opcode.CHUNK)[1]
    with file_size_limit(second.offset + second.length // 2), ring.writer(path, plan) as writer:
        with pytest.raises(LogError) as error:
            store_all(Recorder(plan, writer, window=1), ring.traffic(plan))
        with pytest.raises(LogError):
            writer.flush()
    assert str(path) in str(error.value)
    assert f"holds at least the steps before {CHUNK_STEPS}; free some space" in str(error.value)
    log = read_log(path)
    assert log.truncated
    found = list(log.records())
    assert found == list(read_log(long_log).records())[: CHUNK_STEPS * len(canonical_order(plan))]


def test_a_disk_that_is_full_from_the_start_is_told_too(ring: Any, plan: Plan, tmp_path: Path) -> None:
    with file_size_limit(100), pytest.raises(LogError, match="holds no whole step"):
        ring.writer(tmp_path / "run.mcap", plan)
