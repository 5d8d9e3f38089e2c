"""Worker processes on this machine: started once, given block after block, replaced when they die."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import TYPE_CHECKING, cast

from orchestrator.backends import fork_server
from orchestrator.backends.child import leave_with_parent, redirect_output
from orchestrator.backends.fleet import without_main_module
from orchestrator.campaign.agenda import Agenda
from orchestrator.campaign.block import Work, failed_block, run_block

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerProcess

_GRACE_S = 2.0
_LONGEST_WAIT_S = 60.0
_READY = b"ready"

Answer = tuple[Work, bytes]
"""A block and the Arrow stream of its rows."""


def worker_main(pipe: Connection, name: str, log_file: Path) -> None:
    """Answer one block after another, until there is none or the parent is gone."""
    redirect_output(log_file, append=True)  # to what those said in whose place this one may be
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    leave_with_parent()
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"), suppress(EOFError):
        pipe.send_bytes(_READY)
        while (work := pipe.recv()) is not None:
            pipe.send_bytes(run_block(work, name))


@dataclass
class _Worker:
    """One process with the block that it works on, since it was given that or, if later, was ready."""

    name: str
    process: ForkServerProcess
    pipe: Connection
    work: Work | None = None
    since_s: float = 0.0
    is_ready: bool = False
    is_late: bool = False


class LocalWorkers:
    """Some worker processes; leaving the context ends them.

    Parameters
    ----------
    count
        How many.
    modules
        What their trials need, loaded once for all of them.
    log_dir
        Where what they print is kept, a file a worker.
    patience_s
        How long a trial may take; the worker of one that takes longer is ended.
    """

    def __init__(self, count: int, modules: set[str], log_dir: Path, patience_s: float) -> None:
        self.count = count
        self._patience_s = patience_s
        self._log_dir = log_dir
        fork_server.make_ready(modules | {"orchestrator.campaign.block", "pyarrow", "scipy.special"})
        self._workers: list[_Worker] = []

    def __enter__(self) -> LocalWorkers:
        self._workers = [self._start(str(number)) for number in range(1, self.count + 1)]
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            if worker.work is not None:
                worker.process.kill()
            worker.pipe.close()
        deadline = time.monotonic() + _GRACE_S
        for worker in self._workers:
            worker.process.join(max(0.0, deadline - time.monotonic()))
            if worker.process.exitcode is None:
                worker.process.kill()
                worker.process.join()

    def answers(self, agenda: Agenda) -> Iterator[Answer]:
        """Yield the answers as they come, until nothing is left to do.

        A block whose worker died is tried once more, trial by trial; a trial that dies again has failed.
        """
        while True:
            for worker in self._workers:
                if worker.work is None:
                    self._give(worker, agenda)
            busy = {worker.pipe: worker for worker in self._workers if worker.work is not None}
            if not busy:
                return
            for pipe in wait(list(busy), self._left_s(busy.values())):
                yield from self._take(busy[cast("Connection", pipe)], agenda)
            self._end_late_ones(busy.values())

    def _left_s(self, busy: Iterable[_Worker]) -> float:
        """Return how long to wait at most: until the first of the workers is late."""
        left_s = min(self._deadline_s(worker) for worker in busy) - time.monotonic()
        return min(max(0.0, left_s), _LONGEST_WAIT_S)

    def _deadline_s(self, worker: _Worker) -> float:
        if worker.work is None or worker.is_late or not worker.is_ready:
            return float("inf")
        return worker.since_s + self._patience_s * len(worker.work.trials)

    def _end_late_ones(self, busy: Iterable[_Worker]) -> None:
        """Kill the workers that are late; they are found dead when their pipes are read."""
        for worker in busy:
            if time.monotonic() >= self._deadline_s(worker):
                worker.is_late = True
                worker.process.kill()

    def _give(self, worker: _Worker, agenda: Agenda) -> None:
        work = agenda.next()
        if work is None:
            return
        try:
            worker.pipe.send(work)
        except ConnectionError:  # it died while it had nothing to do
            self._replace(worker)
            worker.pipe.send(work)
        worker.work, worker.since_s = work, time.monotonic()

    def _take(self, worker: _Worker, agenda: Agenda) -> Iterator[Answer]:
        """Yield a worker's answer, or that of its death, after it was given its next block."""
        work, taken_s = worker.work, time.monotonic() - worker.since_s
        assert work is not None
        try:
            answer = worker.pipe.recv_bytes()
        except (EOFError, ConnectionError):
            message = self._replace(worker)
            answer = b"" if agenda.died(work) else failed_block(work, message, worker.name)
        else:
            if answer == _READY:
                worker.is_ready, worker.since_s = True, time.monotonic()
                return
            agenda.note(len(work.trials), taken_s)
        worker.work = None
        self._give(worker, agenda)
        if answer:
            yield work, answer

    def _replace(self, worker: _Worker) -> str:
        """Start a new process in the place of one that died; return how that one ended."""
        worker.pipe.close()
        worker.process.join()
        code = worker.process.exitcode or 0
        was_late = worker.is_late
        fresh = self._start(worker.name)
        worker.process, worker.pipe = fresh.process, fresh.pipe
        worker.is_ready = worker.is_late = False
        if was_late:
            return f"it took longer than {self._patience_s:g} s, twice; see --trial-timeout"
        if code < 0:
            cause = " (out of memory?)" if -code == signal.SIGKILL else ""
            return f"its worker was ended twice by {signal.Signals(-code).name}{cause}"
        return f"its worker ended twice, at last with exit code {code}; see its log in 'workers'"

    def _start(self, name: str) -> _Worker:
        ours, theirs = multiprocessing.Pipe()
        process = multiprocessing.get_context("forkserver").Process(
            target=worker_main, args=(theirs, name, self._log_dir / f"{name}.log"), name=f"worker {name}"
        )
        with without_main_module():
            process.start()
        theirs.close()
        return _Worker(name, process, ours)
