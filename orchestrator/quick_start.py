"""From a file to a topology that is to be run at once."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator.backends import fork_server

if TYPE_CHECKING:
    from orchestrator.choices import Backend
    from orchestrator.topology.resolved import Topology


def load_to_run(
    file: Path, overrides: Sequence[str] = (), seed: int | None = None, backend: Backend | None = None
) -> tuple[Topology, Backend]:
    """Return a topology that is ready to run, and the backend to run it on: the file's unless one is given.

    Meanwhile the process that forks the nodes loads what they need, on another processor. None is left when
    the run needs none; if the topology is bad (`orchestrator.topology.load.TopologyError`), until the exit.
    """
    if backend != "inprocess":
        fork_server.start_early()
    with _without_collections():
        import orchestrator.run  # noqa: F401  part of what starting a run takes
        from orchestrator.topology.load import load_topology

        topology = load_topology(file, overrides, seed)
        chosen = backend or topology.backend
    if chosen == "inprocess":
        fork_server.end_early()
    return topology, chosen


@contextmanager
def _without_collections() -> Iterator[None]:
    """Collect no garbage: nearly all that is made here stays, and no later collection looks at it again."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
