"""Worker processes on this machine: started once, given block after block, replaced when they die."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path
from typing import Protocol

from orchestrator.backends import fork_server
from orchestrator.campaign.block import Work, failed_block
from orchestrator.campaign.failures import ended, too_long
from orchestrator.campaign.worker_process import WorkerEndedError, WorkerProcess

_GRACE_S = 2.0
_LONGEST_WAIT_S = 60.0
_CHECK_S = 1.0

Answer = tuple[Work, bytes]
"""A block and the Arrow stream of its rows."""


@dataclass
class _Worker:
    """A place with its process, and its block: since when it was given that or, if later, was ready."""

    name: str
    process: WorkerProcess
    work: Work | None = None
    since_s: float = 0.0
    is_late: bool = False


class Blocks(Protocol):
    """Where blocks come from, as `orchestrator.campaign.agenda.Agenda` has them."""

    def next(self) -> Work | None:
        """Return the next block, None when there is none."""
        ...

    def note(self, trials: int, taken_s: float) -> None:
        """Note how long one worker took for some trials."""
        ...

    def died(self, work: Work) -> bool:
        """Take back a block whose worker died; return whether its trials will be tried once more."""
        ...


class LocalWorkers:
    """Some worker processes; leaving the context ends them.

    Parameters
    ----------
    names
        What each of them is called.
    modules
        What their trials need, loaded once for all of them.
    log_dir
        Where what they print is kept, a file a worker.
    patience_s
        How long a trial may take; the worker of one that takes longer is ended.
    code
        What must be known of the code of a user's own where they load it themselves, from files that may be
        others than those of whoever asks; see `orchestrator.campaign.user_code`.
    """

    def __init__(
        self,
        names: Sequence[str],
        modules: set[str],
        log_dir: Path,
        patience_s: float,
        code: Mapping[str, str] | None = None,
    ) -> None:
        self.count = len(names)
        self._names = names
        self._patience_s = patience_s
        self._log_dir = log_dir
        self._code = code
        fork_server.make_ready(modules | {"orchestrator.campaign.block", "pyarrow", "scipy.special"})
        self._workers: list[_Worker] = []

    def __enter__(self) -> LocalWorkers:
        self._workers = [_Worker(name, self._start(name)) for name in self._names]
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            if worker.work is not None:
                worker.process.kill()
        deadline = time.monotonic() + _GRACE_S
        for worker in self._workers:
            worker.process.end(max(0.0, deadline - time.monotonic()))

    def answers(self, agenda: Blocks, check: Callable[[], None] | None = None) -> Iterator[Answer]:
        """Yield the answers as they come, until nothing is left to do.

        A block whose worker died is tried once more, trial by trial; a trial that dies again has failed.
        ``check`` is called about every second: what it raises ends this.
        """
        longest_s = _LONGEST_WAIT_S if check is None else _CHECK_S
        while True:
            for worker in self._workers:
                if worker.work is None:
                    self._give(worker, agenda)
            busy = [worker for worker in self._workers if worker.work is not None]
            if not busy:
                return
            told = {source for own in busy for source in (own.process.pipe, own.process.sentinel)}
            heard = set(wait(told, min(self._left_s(busy), longest_s)))
            if check is not None:
                check()
            for worker in busy:
                if heard & {worker.process.pipe, worker.process.sentinel}:
                    yield from self._take(worker, agenda)
            self._end_late_ones(busy)

    def _left_s(self, busy: Iterable[_Worker]) -> float:
        """Return how long to wait at most: until the first of the workers is late."""
        left_s = min(self._deadline_s(worker) for worker in busy) - time.monotonic()
        return max(0.0, left_s)

    def _deadline_s(self, worker: _Worker) -> float:
        if worker.work is None or worker.is_late or not worker.process.is_ready:
            return float("inf")
        return worker.since_s + self._patience_s * len(worker.work.trials)

    def _end_late_ones(self, busy: Iterable[_Worker]) -> None:
        """Kill the workers that are late; their sentinels tell of their ends."""
        for worker in busy:
            if time.monotonic() >= self._deadline_s(worker):
                worker.is_late = True
                worker.process.kill()

    def _give(self, worker: _Worker, agenda: Blocks) -> None:
        work = agenda.next()
        if work is None:
            return
        try:
            worker.process.send(work)
        except WorkerEndedError:  # while it had nothing to do
            self._replace(worker)
            worker.process.send(work)
        worker.work, worker.since_s = work, time.monotonic()

    def _take(self, worker: _Worker, agenda: Blocks) -> Iterator[Answer]:
        """Yield a worker's answer, or that of its death, after it was given its next block."""
        work, taken_s = worker.work, time.monotonic() - worker.since_s
        assert work is not None
        try:
            answer = worker.process.answer()
        except WorkerEndedError:
            message = self._replace(worker)
            answer = b"" if agenda.died(work) else failed_block(work, message, worker.name)
        else:
            if answer is None:
                worker.since_s = time.monotonic()
                return
            agenda.note(len(work.trials), taken_s)
        worker.work = None
        self._give(worker, agenda)
        if answer:
            yield work, answer

    def _replace(self, worker: _Worker) -> str:
        """Start a new process in the place of one that died; return how that one ended."""
        code = worker.process.end(_GRACE_S)
        was_late = worker.is_late
        worker.process, worker.is_late = self._start(worker.name), False
        return too_long(self._patience_s) if was_late else ended(code)

    def _start(self, name: str) -> WorkerProcess:
        return WorkerProcess(name, self._log_dir / f"{name}.log", self._code)
