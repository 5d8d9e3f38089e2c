"""From a file to a topology that is to be run at once."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator.backends import fork_server

if TYPE_CHECKING:
    from orchestrator.run import Backend
    from orchestrator.topology.resolved import Topology


def load_to_run(
    file: Path, overrides: Sequence[str] = (), seed: int | None = None, backend: Backend | None = None
) -> tuple[Topology, Backend]:
    """Return a topology that is ready to run, and the backend to run it on: the file's unless one is given.

    Meanwhile the process that forks the nodes loads what they need, on another processor. There is none left
    if the run needs none, or if the topology is bad (`orchestrator.topology.load.TopologyError`).
    """
    with _without_collections(), _fork_server_under_way(backend):
        import orchestrator.run  # noqa: F401  part of what starting a run takes
        from orchestrator.topology.load import load_topology

        topology = load_topology(file, overrides, seed)
        chosen = backend or topology.backend
    if chosen == "inprocess":
        fork_server.end_early()
    return topology, chosen


@contextmanager
def _fork_server_under_way(backend: Backend | None) -> Iterator[None]:
    """Start it unless it is known to be of no use; end it when the topology cannot be read."""
    if backend != "inprocess":
        fork_server.start_early()
    try:
        yield
    except BaseException:
        fork_server.end_early()
        raise


@contextmanager
def _without_collections() -> Iterator[None]:
    """Collect no garbage: nearly all that is made here stays, and no later collection looks at it again."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
