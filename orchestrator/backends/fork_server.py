"""The process that the nodes of a run are forked from: no process of the run, and no node itself.

It is `multiprocessing`'s own. Started early, it loads what nodes need while the topology is read.
"""

from __future__ import annotations

import atexit
import os
import signal
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import forkserver, resource_tracker
from typing import Any

ONE_BLAS_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Sums are taken in one order only if one thread takes them; the libraries read this when they are loaded."""

_PRELOADED = "orchestrator.backends.preloaded"
_server: Any = forkserver._forkserver
_tracker: Any = resource_tracker._resource_tracker
_early = threading.Event()  # set while a server that was started early has forked nothing


def start_early() -> None:
    """Start it, if there is none yet; it loads what it can without knowing the topology.

    If no run comes of it, it is ended before the interpreter exits.
    """
    is_first = _server._forkserver_pid is None
    _start(())
    if is_first:
        _early.set()
        atexit.register(end_early)


def end_early() -> None:
    """End it if it was started early and has forked nothing; it is gone on return.

    It is killed: to hear that it may leave, it would first load everything.
    """
    if not _early.is_set():
        return
    _forget()
    with suppress(ProcessLookupError):
        os.kill(_server._forkserver_pid, signal.SIGKILL)
    _server._stop()
    _tracker._stop()


def make_ready(modules: Collection[str]) -> None:
    """See to it that there is one to fork from, which has loaded the modules of a plan's kinds.

    One that was started early knows our own kinds only. One that has forked already stays as it is.
    """
    from orchestrator.registry import own_modules

    foreign = sorted(set(modules) - set(own_modules()))
    if foreign:
        end_early()
    _forget()
    _start(foreign)


def _forget() -> None:
    _early.clear()
    atexit.unregister(end_early)


def _start(modules: Collection[str]) -> None:
    os.environ.update(ONE_BLAS_THREAD)
    forkserver.set_forkserver_preload([_PRELOADED, *modules])
    with _deaf_to_ctrl_c():
        forkserver.ensure_running()


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Let what is started inside ignore Ctrl-C from its first moment: it is the orchestrator's to handle."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
