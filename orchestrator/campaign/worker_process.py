"""One worker process: given block after block, answering each; ended with all that its trials started."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from bus.kinds import KindError
from orchestrator.backends.child import leave_with_parent, redirect_output
from orchestrator.backends.fleet import without_main_module
from orchestrator.campaign.block import Work, code_of_block, run_block
from orchestrator.campaign.user_code import changed_code
from orchestrator.errors import InputError

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerProcess

_READY = b"ready"
_TROUBLE = b"trouble: "
_STARTING = threading.Lock()


class WorkerEndedError(Exception):
    """A worker ended before it answered."""


class OtherCodeError(InputError):
    """A worker has other code of a user's own than the campaign; the text tells which, and the cure."""


def worker_main(pipe: Connection, name: str, log_file: Path, code: Mapping[str, str] | None) -> None:
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
            trouble = "" if code is None else _trouble(work, code)
            pipe.send_bytes(_TROUBLE + trouble.encode() if trouble else run_block(work, name))


def _trouble(work: Work, code: Mapping[str, str]) -> str:
    """Return what is wrong with the code of a user's own that a block runs here, empty when nothing is."""
    try:
        changed = changed_code(code, code_of_block(work))
    except (KindError, OSError) as error:
        return f"cannot load its classes: {error}"
    return f"has other code of {', '.join(changed)}" if changed else ""


class WorkerProcess:
    """A process that works on blocks.

    Parameters
    ----------
    name
        What its rows of timings call it.
    log_file
        Where what it prints is added.
    code
        What must be known of the code of a user's own that it loads, None when that need not be looked at.
    """

    def __init__(self, name: str, log_file: Path, code: Mapping[str, str] | None = None) -> None:
        self.pipe, theirs = multiprocessing.Pipe()
        self._process: ForkServerProcess = multiprocessing.get_context("forkserver").Process(
            target=worker_main, args=(theirs, name, log_file, code), name=f"worker {name}"
        )
        with _STARTING, without_main_module(), _with_children():
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

        To be called when the pipe or the sentinel has something to tell. Raises `WorkerEndedError`, and
        `OtherCodeError`.
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
        if answer.startswith(_TROUBLE):
            trouble = answer.removeprefix(_TROUBLE).decode()
            raise OtherCodeError(f"{self._process.name} {trouble}; it needs the files that are here")
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


@contextmanager
def _with_children() -> Iterator[None]:
    """Let this process have children even where it is a daemonic one itself, as a worker of Dask is.

    That is forbidden since they would outlive it; ours leave with their parent.
    """
    config = vars(multiprocessing.current_process())["_config"]
    is_daemonic = config.pop("daemon", None)
    try:
        yield
    finally:
        if is_daemonic is not None:
            config["daemon"] = is_daemonic
