"""What a log is, told without its messages: for `gauntlet log info`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Statistics

from orchestrator.log.reader import Log, read_log
from orchestrator.log.scan import read_part


def _counts(log: Log) -> tuple[dict[str, int], int]:
    """Return the messages of each topic and the steps recorded: from the summary, or by counting."""
    parts = log.layout.of(Opcode.STATISTICS)
    if log.truncated or not parts:
        topics, steps_recorded = log.counts()
        return dict(topics), steps_recorded
    with log.path.open("rb") as stream:
        counts = read_part(stream, parts[0], Statistics.read).channel_message_counts
    held = {topic: counts.get(number, 0) for number, topic in log.topics().items()}
    return held, int(log.outcome["steps_recorded"])


def describe(path: Path) -> dict[str, Any]:
    """Return what a log is: plain data, ready for JSON; raises LogError for a damaged or foreign file."""
    log = read_log(path)
    topics, steps_recorded = _counts(log)
    facts = log.provenance
    period_s = float(facts["period_s"])
    versions = {
        key.removeprefix("version."): text for key, text in facts.items() if key.startswith("version.")
    }
    return {
        "path": str(path),
        "bytes": path.stat().st_size,
        "name": facts["name"],
        "topology_hash": facts.get("topology_hash", "none"),
        "seed": int(facts["seed"]),
        "trial": int(facts.get("trial", "0")),
        "git_commit": facts.get("git_commit", "none"),
        "machine": facts.get("machine", "none"),
        "versions": versions,
        "steps": int(facts["steps"]),
        "steps_recorded": steps_recorded,
        "period_s": period_s,
        "duration_s": steps_recorded * period_s,
        "complete": log.complete,
        "truncated": log.truncated,
        "recovered": log.outcome.get("recovered") == "true",
        "messages": sum(topics.values()),
        "topics": topics,
        "score": log.score,
    }


def _state(facts: dict[str, Any]) -> str:
    """Tell in a word or two how whole a log is."""
    if facts["truncated"]:
        return "cut off; `gauntlet log recover` makes it whole"
    state = "complete" if facts["complete"] else "incomplete"
    return f"{state}, recovered" if facts["recovered"] else state


def describe_lines(facts: dict[str, Any]) -> list[str]:
    """Return a description as lines for people."""
    versions = ", ".join(f"{name} {version}" for name, version in facts["versions"].items())
    rows = {
        "log": f"{facts['path']} ({facts['bytes']:,} bytes)",
        "topology": f"{facts['name']}, hash {facts['topology_hash']}",
        "seed": f"{facts['seed']}, trial {facts['trial']}",
        "steps": f"{facts['steps_recorded']} of {facts['steps']}, {facts['duration_s']:g} s simulated",
        "state": _state(facts),
        "score": "none" if facts["score"] is None else "attached",
        "versions": f"{versions} on {facts['machine']}; commit {facts['git_commit']}",
        "messages": f"{facts['messages']:,}",
    }
    lines = [f"{name:<9} {text}" for name, text in rows.items()]
    return [*lines, *(f"{count:>9,}  {topic}" for topic, count in facts["topics"].items())]
