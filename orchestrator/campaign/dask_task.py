"""A block on a worker of a Dask cluster: a process beside the worker carries it out, as a local worker would.

So a trial that dies or takes too long costs that process and not the worker of Dask, with which all blocks
that it has at hand would be blamed. The process is kept for the next block of the same campaign, for a while.
"""

from __future__ import annotations

import atexit
import re
import tempfile
import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from distributed import get_worker

from orchestrator.campaign.block import Work
from orchestrator.campaign.workers import LocalWorkers

_KEPT_S = 20.0
_MOST_PRINTED = 1 << 20
"""Bytes of what was printed during a block that are sent back: the last of them."""


class AbandonedError(Exception):
    """Nobody waits for this block any more."""


@dataclass(frozen=True)
class Orders:
    """What holds for all blocks of a campaign.

    Parameters
    ----------
    campaign
        A name that no other sweep has.
    patience_s
        How long a trial may take.
    code
        What must be known of the code of a user's own; see `orchestrator.campaign.user_code`.
    """

    campaign: str
    patience_s: float
    code: Mapping[str, str]


@dataclass(frozen=True)
class Outcome:
    """What became of a block.

    Parameters
    ----------
    answers
        Its parts with their answers: all of it, or trial by trial when its first try was lost.
    finished, spent_s
        How many trials were answered by a living process, and the time that they took (s).
    worker, printed
        What the process is called, and what it printed.
    """

    answers: list[tuple[Work, bytes]]
    finished: int
    spent_s: float
    worker: str
    printed: bytes


class _OneBlock:
    """An agenda of one block: when its worker dies it comes back trial by trial, once."""

    def __init__(self, work: Work) -> None:
        self._left = deque([work])
        self._is_again = False
        self.finished = 0
        self.spent_s = 0.0

    def next(self) -> Work | None:
        """Return the block, and later its trials if they are to be tried again."""
        return self._left.popleft() if self._left else None

    def note(self, trials: int, taken_s: float) -> None:
        """Note how long trials took."""
        self.finished += trials
        self.spent_s += taken_s

    def died(self, work: Work) -> bool:
        """Take the block back; return whether its trials will be tried once more."""
        if self._is_again:
            return False
        self._is_again = True
        self._left += [replace(work, trials=(trial,)) for trial in work.trials]
        return True


class _Station:
    """A worker process for the blocks that one thread of a worker of Dask is given."""

    def __init__(self, orders: Orders, name: str) -> None:
        self.orders = orders
        self._name = name
        self._folder = tempfile.TemporaryDirectory(prefix="gauntlet-", dir=get_worker().local_directory)
        self._log = Path(self._folder.name) / f"{name}.log"
        self._read = 0
        # without the modules of a user's own: each process shall load them as they are
        self._workers = LocalWorkers(
            [name], set(), Path(self._folder.name), orders.patience_s, orders.code
        ).__enter__()
        self.timer: threading.Timer | None = None

    def run(self, work: Work) -> Outcome:
        block = _OneBlock(work)
        answers = list(self._workers.answers(block, _raise_if_abandoned))
        return Outcome(answers, block.finished, block.spent_s, self._name, self._printed())

    def close(self) -> None:
        self._workers.__exit__(None, None, None)
        self._folder.cleanup()

    def _printed(self) -> bytes:
        with self._log.open("rb") as stream:
            stream.seek(self._read)
            found = stream.read()
        self._read += len(found)
        return found[-_MOST_PRINTED:]


_stations: dict[int, _Station] = {}
_numbers: dict[int, int] = {}
_lock = threading.Lock()


def carry_out(work: Work, orders: Orders) -> Outcome:
    """Run a block; it is called in a thread of a worker of Dask.

    Raises
    ------
    AbandonedError
        The block was called off; its process is gone.
    OtherCodeError
        The files of the user's own classes are others here.
    """
    thread = threading.get_ident()
    with _lock:
        station = _stations.pop(thread, None)
        number = _numbers.setdefault(thread, len(_numbers) + 1)
    if station is not None and station.timer is not None:
        station.timer.cancel()
    if station is not None and station.orders != orders:
        station.close()
        station = None
    if station is None:
        station = _Station(orders, f"{_as_name(get_worker().address)}-{number}")
    try:
        outcome = station.run(work)
    except BaseException:
        station.close()
        raise
    _keep(thread, station)
    return outcome


def _keep(thread: int, station: _Station) -> None:
    """Keep a station for the next block, but not for long."""
    station.timer = threading.Timer(_KEPT_S, _dismiss, (thread, station))
    station.timer.daemon = True
    with _lock:
        _stations[thread] = station
    station.timer.start()


def _dismiss(thread: int, station: _Station) -> None:
    """Close a station, unless it is at work again."""
    with _lock:
        if _stations.get(thread) is not station:
            return
        del _stations[thread]
    station.close()


@atexit.register
def _dismiss_all() -> None:
    """Close what is kept: an interpreter that ends waits for its children."""
    for thread, station in list(_stations.items()):
        _dismiss(thread, station)


def _raise_if_abandoned() -> None:
    worker = get_worker()
    task = worker.state.tasks.get(worker.get_current_task())
    if task is None or task.state == "cancelled":
        raise AbandonedError


def _as_name(address: str) -> str:
    """Return the address of a worker as a part of a file's name."""
    return re.sub(r"[^\w.]+", "-", address.partition("://")[2])
