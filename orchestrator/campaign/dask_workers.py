"""The workers of a Dask cluster: the same blocks, and the same bytes, on other hosts."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

from bus.extras import installing
from orchestrator.backends.contract import RunFailedError
from orchestrator.campaign.agenda import Agenda
from orchestrator.campaign.block import Work, failed_block, run_block
from orchestrator.errors import InputError
from orchestrator.evidence.table import MissingPackageError
from orchestrator.log.provenance import versions

_CONNECT_S = 10
_AHEAD = 2
"""Blocks that each thread of the cluster has at hand: one to work on, one to go on with."""


def _versions_there() -> dict[str, str]:
    """Return a worker's versions; it is called there."""
    import pyarrow

    return {**versions(), "version.pyarrow": pyarrow.__version__}


def _run_there(work: Work) -> tuple[bytes, float]:
    """Run a block in a worker of the cluster; return its answer and the time that it took (s)."""
    from distributed import get_worker
    from threadpoolctl import threadpool_limits

    begun_s = time.perf_counter()
    with threadpool_limits(limits=1, user_api="blas"):
        answer = run_block(work, str(get_worker().address))
    return answer, time.perf_counter() - begun_s


class DaskWorkers:
    """The workers of the cluster that a scheduler leads.

    Parameters
    ----------
    address
        Of the scheduler, as in ``tcp://host:8786``.

    Raises
    ------
    InputError
        Dask is not installed, nobody answers there, there is no worker, or one has other versions than this
        process: its bytes could differ.
    """

    def __init__(self, address: str) -> None:
        self._address = address
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

        A block that the cluster gave up with its worker is tried once more, trial by trial.
        """
        from distributed import as_completed
        from distributed.scheduler import KilledWorker

        under_way: dict[Any, Work] = {}
        completed = as_completed([], loop=self._client.loop)

        def hand_out() -> None:
            while len(under_way) < _AHEAD * self.count and (work := agenda.next()) is not None:
                future = self._client.submit(_run_there, work, pure=False)
                under_way[future] = work
                completed.add(future)

        hand_out()
        while under_way:
            future = next(completed)
            work = under_way.pop(future)
            error = future.exception()
            answer = b""
            if error is None:
                answer, taken_s = future.result()
                agenda.note(len(work.trials), taken_s)
            elif not isinstance(error, KilledWorker):
                raise RunFailedError(f"the Dask cluster failed ({error!r}); give the command again to go on")
            elif not agenda.died(work):
                answer = failed_block(work, "its worker on the Dask cluster died, time and again", "none")
            hand_out()
            if answer:
                yield work, answer
