"""One run from topology to verdict: directory, log, backend, score."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from bus.program import NodeError
from orchestrator import exit_codes
from orchestrator.backends.contract import Progress, RunFailedError, Timing
from orchestrator.choices import Backend
from orchestrator.errors import InputError
from orchestrator.interrupts import UNINTERRUPTED, Interrupted, raising_interrupts
from orchestrator.log.errors import LogError
from orchestrator.log.order import canonical_topics
from orchestrator.log.provenance import provenance
from orchestrator.log.recorder import Recorder
from orchestrator.log.writer import LogWriter
from orchestrator.run_directory import LOG, NODE_LOGS, SCORE, TIMING, TOPOLOGY
from orchestrator.score.results import Score
from orchestrator.topology.resolved import Topology


class NotBegunError(InputError):
    """The files of a run cannot be begun, so nothing of it would be recorded; the text tells the cure."""


@dataclass(frozen=True)
class RunReport:
    """What became of a run. ``message`` says what went wrong, empty when it went to its end."""

    directory: Path
    exit_code: int
    message: str
    score: Score
    timing: Timing
    backend: Backend

    def files(self) -> dict[str, str]:
        """Return where things were written, by a word for each."""
        names = {"log": LOG, "score": SCORE, "timing": TIMING, "topology": TOPOLOGY}
        if self.backend == "processes":
            names["node logs"] = NODE_LOGS
        paths = {word: self.directory / name for word, name in names.items()}
        return {word: str(path) for word, path in paths.items() if path.exists()}

    def facts(self) -> dict[str, object]:
        """Return the whole report as plain data, ready for JSON."""
        return {
            "directory": str(self.directory),
            "exit_code": self.exit_code,
            "message": self.message,
            "score": msgspec.Raw(self.score.to_json()),
            "timing": self.timing.facts(self.backend),
        }


def _pretty(facts: Mapping[str, object]) -> bytes:
    return msgspec.json.format(msgspec.json.encode(facts), indent=2) + b"\n"


def _unwritable(path: Path, error: OSError, option: str) -> str:
    return f"{path} cannot be written: {error.strerror}; free some space or choose another {option}"


def _write_whole(path: Path, content: bytes) -> None:
    """Write a file; leave none behind, rather than half of it, when that fails."""
    try:
        path.write_bytes(content)
    except OSError:
        path.unlink(missing_ok=True)
        raise


def _begin_log(topology: Topology, directory: Path, option: str) -> LogWriter:
    """Write the resolved topology and the beginning of the log."""
    facts = provenance(topology.plan, topology.hash)
    topics = canonical_topics(topology.plan)
    try:
        _write_whole(directory / TOPOLOGY, topology.resolved_yaml().encode())
        return LogWriter(directory / LOG, facts, topology.experiment_json(), topics)
    except OSError as error:
        raise NotBegunError(_unwritable(directory / TOPOLOGY, error, option)) from error
    except LogError as error:
        raise NotBegunError(str(error)) from error


def _carry_out(
    topology: Topology,
    recorder: Recorder,
    backend: Backend,
    directory: Path,
    progress: Progress,
    timing: Timing,
) -> tuple[int, str]:
    """Run the backend; return the exit code so far and what went wrong."""
    try:
        if backend == "processes":
            from orchestrator.backends.processes import run_in_processes

            log_dir = directory / NODE_LOGS
            run_in_processes(topology.plan, recorder, topology.settings, log_dir, progress, timing)
        else:
            from orchestrator.backends.inprocess import run_in_one_process

            run_in_one_process(topology.plan, recorder, topology.settings, progress, timing)
    except Interrupted as interrupt:
        return interrupt.exit_code, f"interrupted by {interrupt}"
    except (RunFailedError, LogError) as error:
        return exit_codes.RUN_FAILED, str(error)
    except NodeError as error:
        if isinstance(error.__cause__, LogError):  # in one process, messages are recorded as they are sent
            return exit_codes.RUN_FAILED, str(error.__cause__)
        sys.excepthook(type(error), error, error.__traceback__)
        return exit_codes.RUN_FAILED, str(error)
    return exit_codes.PASSED, ""


def run_topology(
    topology: Topology, directory: Path, backend: Backend, progress: Progress, option: str = "--out"
) -> RunReport:
    """Run a topology and write log, score, timing, resolved topology and node logs into the directory.

    Whatever happens to the run, what was recorded is kept and scored. ``option`` is what the user chooses the
    place with, for the text of errors. Raises `NotBegunError` when not even the beginning of the log can be
    written.
    """
    timing = Timing()
    with raising_interrupts(), _begin_log(topology, directory, option) as writer:
        recorder = Recorder(topology.plan, writer, topology.settings.window)
        code, message = _carry_out(topology, recorder, backend, directory, progress, timing)
        with UNINTERRUPTED:
            result, trouble = _conclude(recorder, writer, directory / LOG)
            beside = {SCORE: result.to_json(), TIMING: _pretty(timing.facts(backend))}
            trouble = _write_beside(directory, beside, option) or trouble
    if trouble:
        code, message = exit_codes.RUN_FAILED, message or trouble
    elif code == exit_codes.PASSED and not result.passed:
        code = exit_codes.EXPECTATION_FAILED
    return RunReport(directory, code, message, result, timing, backend)


def _conclude(recorder: Recorder, writer: LogWriter, log: Path) -> tuple[Score, str]:
    """Finish the log, with the score that it gives; return the score and what went wrong."""
    from orchestrator.score_of_log import score_of_log  # late: no run needs it in order to start

    try:
        recorder.write_partial_steps()
        writer.flush()
        result = score_of_log(log, recorder.departed)
        writer.finish(recorder.outcome(), result.to_json())
    except LogError as error:
        return score_of_log(log, recorder.departed), str(error)
    return result, ""


def _write_beside(directory: Path, contents: Mapping[str, bytes], option: str) -> str:
    """Write files beside the log; return what went wrong with the last that could not be written."""
    trouble = ""
    for name, content in contents.items():
        try:
            _write_whole(directory / name, content)
        except OSError as error:
            trouble = _unwritable(directory / name, error, option)
    return trouble
