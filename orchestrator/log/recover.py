"""Writes a whole log again from one that was cut off or damaged."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from orchestrator.log.errors import LogError
from orchestrator.log.reader import Log, read_log
from orchestrator.log.recorder import outcome_facts
from orchestrator.log.writer import LogWriter


class Recovery(NamedTuple):
    """What could be saved: the new file, what it holds, and how many chunks of the old one were damaged."""

    path: Path
    messages: int
    whole_steps: int
    damaged_chunks: int


def recovered_name(path: Path) -> Path:
    """Return where a log is recovered to by default: ``run.mcap`` to ``run.recovered.mcap``."""
    return path.with_name(f"{path.stem}.recovered{path.suffix}")


def recover(path: Path, out: Path | None = None) -> Recovery:
    """Write everything that can be read of a log to a new file, which says that it was recovered.

    Raises LogError when nothing can be read, when the log is whole, or when ``out`` exists.
    """
    log = read_log(path, check=False)
    if _is_whole(log):
        raise LogError(f"{path} is whole; there is nothing to recover")
    return _rewrite(log, recovered_name(path) if out is None else out)


def _is_whole(log: Log) -> bool:
    try:
        return not read_log(log.path).truncated
    except LogError:
        return False


def _rewrite(log: Log, out: Path) -> Recovery:
    per_step = int(log.provenance["messages_per_step"])
    damaged: list[LogError] = []
    messages = whole_steps = 0
    with LogWriter(out, log.provenance, log.topology_json, tuple(log.topics().values())) as writer:
        for step, held in log.steps(on_damage=damaged.append):
            writer.write_step(step, [(payload.topic, payload.json) for payload in held])
            messages += len(held)
            whole_steps += step == whole_steps and len(held) == per_step
        told = outcome_facts(whole_steps, int(log.provenance["steps"]))
        facts = {**told, "recovered": "true", "damaged_chunks": str(len(damaged))}
        writer.finish(facts, None if damaged else log.score_json)
    return Recovery(out, messages, whole_steps, len(damaged))
