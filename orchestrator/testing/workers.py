"""Fresh processes that work for this one, and end with it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context


@contextmanager
def fresh_processes(number: int) -> Iterator[ProcessPoolExecutor]:
    """Give a pool of processes that begin with nothing of this one's state.

    Whatever they are at when the context is left, they are ended, and no other child of this process is. A
    Ctrl-C of the terminal reaches them too: they leave it to this process, except in a run, which takes
    signals itself.
    """
    others = set(active_children())
    pool = ProcessPoolExecutor(
        number,
        mp_context=get_context("spawn"),
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),
    )
    try:
        yield pool
    finally:
        for process in set(active_children()) - others:
            process.kill()
        pool.shutdown(cancel_futures=True)
