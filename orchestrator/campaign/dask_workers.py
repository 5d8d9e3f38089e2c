"""The workers of a Dask cluster: the same blocks, and the same bytes, on other hosts."""

from __future__ import annotations

import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from bus.extras import installing
from orchestrator.backends.contract import RunFailedError
from orchestrator.campaign.agenda import Agenda
from orchestrator.campaign.block import Work, failed_block
from orchestrator.campaign.failures import ended_on_cluster
from orchestrator.errors import InputError
from orchestrator.evidence.table import MissingPackageError
from orchestrator.log.provenance import versions

_CONNECT_S = 10
_LOOK_S = 5.0
"""How often to look for workers while nothing is heard."""
_DESERTED_S = 30.0
"""How long a cluster may be without any: a worker that ended is started again by its nanny."""
_AHEAD = 2
"""Blocks that each thread of the cluster has at hand: one to work on, one to go on with."""


def _versions_there() -> dict[str, str]:
    """Return a worker's versions; it is called there."""
    import pyarrow

    return {**versions(), "version.pyarrow": pyarrow.__version__}


class DaskWorkers:
    """The workers of the cluster that a scheduler leads.

    Parameters
    ----------
    address
        Of the scheduler, as in ``tcp://host:8786``.
    log_dir
        Where what trials print there is kept, a file for each thread of the cluster.
    patience_s
        How long a trial may take; the process of one that takes longer is ended.
    code
        What must be known of the code of a user's own there; see `orchestrator.campaign.user_code`.

    Raises
    ------
    InputError
        Dask is not installed, nobody answers there, there is no worker, or one has other versions than this
        process: its bytes could differ.
    """

    def __init__(self, address: str, log_dir: Path, patience_s: float, code: Mapping[str, str]) -> None:
        self._address = address
        self._log_dir = log_dir
        self._orders = patience_s, code
        self._stack = ExitStack()
        self.count = 0

    def __enter__(self) -> DaskWorkers:
        try:
            from distributed import Client
            from distributed.comm import parse_address
            from distributed.comm.addressing import parse_host_port
        except ImportError as error:
            raise MissingPackageError(
                f"--dask needs Dask; install it with: {installing('cluster')}"
            ) from error
        try:
            parse_host_port(parse_address(self._address)[1])  # a client without a port takes long to be gone
            client = Client(self._address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(
                f"no Dask scheduler answers at {self._address}; start one with 'dask scheduler' ({error})"
            ) from error
        self._client = self._stack.enter_context(client)
        try:
            self._check()
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _check(self) -> None:
        """Count the threads of the cluster, and refuse workers whose bytes could differ."""
        threads: dict[str, int] = self._client.nthreads()
        self.count = sum(threads.values())
        if not self.count:
            raise InputError(
                f"the Dask scheduler at {self._address} has no worker; "
                f"start some with 'dask worker {self._address} --nthreads 1'"
            )
        try:
            there: dict[str, dict[str, str]] = self._client.run(_versions_there)
        except Exception as error:
            raise InputError(f"a Dask worker cannot load gauntlet: {error}; install it there") from error
        here = _versions_there()
        for worker, found in sorted(there.items()):
            other = [f"{name} {found.get(name)}" for name in here if found.get(name) != here[name]]
            if other:
                raise InputError(
                    f"the Dask worker {worker} has {', '.join(other)}, unlike this process; its results "
                    "could differ, so install the same versions there"
                )

    def answers(self, agenda: Agenda) -> Iterator[tuple[Work, bytes]]:
        """Yield the answers as they come, until nothing is left to do.

        A block that the cluster gave up, as several of its workers ended with it, is tried once more: trial
        by trial, each while nothing else is under way, so that none is blamed for another.
        """
        from distributed.scheduler import KilledWorker

        from orchestrator.campaign.dask_task import Orders, Outcome, carry_out

        orders = Orders(uuid.uuid4().hex, *self._orders)
        under_way: dict[Any, Work] = {}
        completed: SimpleQueue[Any] = SimpleQueue()
        suspects = _Suspects(agenda)

        while True:
            while (
                len(under_way) < _AHEAD * self.count and (work := suspects.next(len(under_way))) is not None
            ):
                future = self._client.submit(carry_out, work, orders, pure=False)
                under_way[future] = work
                future.add_done_callback(completed.put)
            if not under_way:
                return
            future = self._next(completed)
            work = under_way.pop(future)
            if future.status == "cancelled":
                raise self._failed("the scheduler is gone")
            error = future.exception()
            if error is None:
                outcome: Outcome = future.result()
                agenda.note(outcome.finished, outcome.spent_s)
                self._keep_printed(outcome.worker, outcome.printed)
                yield from outcome.answers
            elif not isinstance(error, KilledWorker):
                raise self._failed(error)
            elif not suspects.died(work):
                yield work, failed_block(work, ended_on_cluster(), "none")

    def _next(self, completed: SimpleQueue[Any]) -> Any:
        """Return the next future that is done; raises `RunFailedError` when nobody is left to work on it."""
        deserted_s: float | None = None
        while True:
            with suppress(Empty):
                return completed.get(timeout=_LOOK_S)
            try:
                deserted_s = None if self._client.nthreads() else deserted_s or time.monotonic()
            except (OSError, TimeoutError) as error:
                raise self._failed(error) from error
            if deserted_s is not None and time.monotonic() - deserted_s > _DESERTED_S:
                raise self._failed("it has no worker left")

    def _failed(self, cause: object) -> Exception:
        if isinstance(cause, InputError):
            return InputError(f"Dask's {cause}")
        why = cause if isinstance(cause, str) else repr(cause)
        return RunFailedError(
            f"the Dask cluster at {self._address} failed: {why}; the finished trials are kept, and the "
            "command goes on with them when it is given again"
        )

    def _keep_printed(self, worker: str, printed: bytes) -> None:
        if printed:
            with (self._log_dir / f"{worker}.log").open("ab") as log:
                log.write(printed)


class _Suspects:
    """Hands out the blocks of an agenda; those with which workers of the cluster ended, by themselves."""

    def __init__(self, agenda: Agenda) -> None:
        self._agenda = agenda
        self._suspected: set[tuple[int, int]] = set()
        self._held: Work | None = None
        self._is_alone = False

    def next(self, under_way: int) -> Work | None:
        """Return the next block, None when there is none that may be under way beside the others."""
        if under_way and self._is_alone:
            return None
        work, self._held = self._held or self._agenda.next(), None
        if work is None:
            return None
        self._is_alone = (work.variant, work.trials[0]) in self._suspected
        if self._is_alone and under_way:
            self._held, self._is_alone = work, False
            return None
        return work

    def died(self, work: Work) -> bool:
        """Take back a block that was given up; return whether its trials will be tried once more."""
        self._suspected.update((work.variant, trial) for trial in work.trials)
        return self._agenda.died(work)
