"""One worker process: given block after block, answering each; ended with all that its trials started."""

from __future__ import annotations

import multiprocessing
import os
import signal
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator.backends.child import leave_with_parent, redirect_output
from orchestrator.backends.fleet import without_main_module
from orchestrator.campaign.block import Work, run_block

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerProcess

_READY = b"ready"


class WorkerEndedError(Exception):
    """A worker ended before it answered."""


def worker_main(pipe: Connection, name: str, log_file: Path) -> None:
    """Answer one block after another, until there is none or the parent is gone."""
    os.setpgrp()  # what a trial starts belongs to this worker, and ends with it
    redirect_output(log_file, append=True)  # to what those said in whose place this one may be
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    leave_with_parent(with_group=True)
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"), suppress(EOFError):
        pipe.send_bytes(_READY)
        while (work := pipe.recv()) is not None:
            pipe.send_bytes(run_block(work, name))


class WorkerProcess:
    """A process that works on blocks.

    Parameters
    ----------
    name
        What its rows of timings call it.
    log_file
        Where what it prints is added.
    """

    def __init__(self, name: str, log_file: Path) -> None:
        self.pipe, theirs = multiprocessing.Pipe()
        self._process: ForkServerProcess = multiprocessing.get_context("forkserver").Process(
            target=worker_main, args=(theirs, name, log_file), name=f"worker {name}"
        )
        with without_main_module():
            self._process.start()
        theirs.close()
        self.is_ready = False

    @property
    def sentinel(self) -> int:
        """What to wait for, beside the pipe, to hear of its end: what it forked holds the pipe open."""
        return self._process.sentinel

    @property
    def has_ended(self) -> bool:
        """Whether the process itself is gone."""
        return self._process.exitcode is not None

    def send(self, work: Work) -> None:
        """Give it a block; raises `WorkerEndedError`."""
        if self.has_ended:
            raise WorkerEndedError
        try:
            self.pipe.send(work)
        except OSError as error:
            raise WorkerEndedError from error

    def answer(self) -> bytes | None:
        """Return its answer to a block, None when all that it says is that it is ready for one.

        To be called when the pipe or the sentinel has something to tell. Raises `WorkerEndedError`.
        """
        if self.has_ended:
            self.kill()  # whoever else holds the pipe could keep half a message open
            if not self.pipe.poll():
                raise WorkerEndedError
        try:
            answer = self.pipe.recv_bytes()
        except (EOFError, OSError) as error:
            raise WorkerEndedError from error
        if answer == _READY:
            self.is_ready = True
            return None
        return answer

    def kill(self) -> None:
        """End it at once, with all that its trials started."""
        pid = self._process.pid
        assert pid is not None
        with suppress(ProcessLookupError, PermissionError):  # it has no group yet, or no longer
            os.killpg(pid, signal.SIGKILL)
        self._process.kill()

    def end(self, timeout_s: float) -> int:
        """Close the pipe, upon which a worker leaves; kill what is left then, and return its exit code."""
        self.pipe.close()
        self._process.join(timeout_s)
        self.kill()
        self._process.join()
        return self._process.exitcode or 0
