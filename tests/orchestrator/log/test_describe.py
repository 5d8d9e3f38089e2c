from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode

from orchestrator.log.describe import describe, describe_lines
from orchestrator.log.order import canonical_order
from orchestrator.log.reader import read_log
from orchestrator.log.recover import recover
from orchestrator.log.writer import CHUNK_STEPS


def test_a_whole_log_is_described_from_its_summary(log_path: Path, ring: Any) -> None:
    facts = describe(log_path)
    assert json.loads(json.dumps(facts)) == facts
    assert (facts["name"], facts["seed"], facts["topology_hash"]) == ("ring", 7, "0123abcd")
    assert (facts["steps"], facts["steps_recorded"], facts["duration_s"]) == (6, 6, 6 * 0.05)
    assert (facts["complete"], facts["truncated"], facts["recovered"]) == (True, False, False)
    assert facts["messages"] == 6 * len(canonical_order(ring.plan()))
    assert facts["topics"]["tx/e1/exchange"] == 12
    assert facts["bytes"] == log_path.stat().st_size
    assert facts["score"] == {"rmse": 0.5}
    assert "mcap" in facts["versions"]


def test_a_cut_log_is_described_by_counting(long_log: Path, tmp_path: Path) -> None:
    second = read_log(long_log).layout.of(Opcode.CHUNK)[1]
    (tmp_path / "run.mcap").write_bytes(long_log.read_bytes()[: second.offset])
    facts = describe(tmp_path / "run.mcap")
    assert (facts["complete"], facts["truncated"]) == (False, True)
    assert facts["steps_recorded"] == CHUNK_STEPS
    assert facts["topics"]["truth/plant"] == CHUNK_STEPS
    again = describe(recover(tmp_path / "run.mcap").path)
    assert again["recovered"]
    assert again["topics"] == facts["topics"]
    assert again["steps_recorded"] == CHUNK_STEPS


def test_people_are_told_in_lines(log_path: Path, long_log: Path, tmp_path: Path) -> None:
    text = "\n".join(describe_lines(describe(log_path)))
    assert "ring, hash 0123abcd" in text
    assert "6 of 6, 0.3 s simulated" in text
    assert "state     complete" in text
    assert "       12  tx/e1/exchange" in text
    (tmp_path / "run.mcap").write_bytes(long_log.read_bytes()[:-1])
    assert "cut off" in "\n".join(describe_lines(describe(tmp_path / "run.mcap")))
    assert "complete, recovered" in "\n".join(describe_lines(describe(recover(tmp_path / "run.mcap").path)))


def test_topics_without_messages_are_told_too(ring: Any, tmp_path: Path) -> None:
    plan = ring.plan()
    facts = describe(ring.write(tmp_path / "run.mcap", plan, ring.traffic(plan)[:1]))
    assert facts["topics"]["estimate/e1"] == 0
    assert facts["messages"] == 1
