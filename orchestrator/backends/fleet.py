"""The processes of a run: started from one preloaded process, watched, and ended together."""

from __future__ import annotations

import multiprocessing
import pickle
import sys
import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Self

from bus.plan import Plan
from bus.process import Membership
from orchestrator.backends import fork_server
from orchestrator.backends.child import child_main

_GRACE_S = 1.5


class Fleet:
    """All child processes of one run; leaving the context ends those that are left."""

    def __init__(self, plan: Plan, members: Iterable[Membership], log_dir: Path) -> None:
        fork_server.make_ready(kind_modules(plan))
        context = multiprocessing.get_context("forkserver")
        pickled_plan = pickle.dumps(plan)  # once for all
        self._processes: dict[str, ForkServerProcess] = {
            member.name: context.Process(
                target=child_main,
                args=(pickled_plan, member, log_dir / f"{member.name}.log"),
                name=member.name,
            )
            for member in members
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()

    def start(self) -> None:
        """Start every process."""
        with without_main_module():
            for process in self._processes.values():
                process.start()

    def failed(self) -> dict[str, int]:
        """Return the exit code of every process that did not end well; a negative one is a signal's."""
        return {
            name: process.exitcode
            for name, process in self._processes.items()
            if process.pid is not None and process.exitcode not in (None, 0)
        }

    def wait_for_all(self, timeout_s: float, without: Collection[str] = ()) -> None:
        """Return when every process but some has ended, or after the timeout."""
        deadline = time.monotonic() + timeout_s
        for process in self._started():
            if process.name in without:
                continue
            process.join(max(0.0, deadline - time.monotonic()))

    def pid(self, name: str) -> int | None:
        """Return the process id of a node, None before it is started."""
        return self._processes[name].pid

    def end(self) -> None:
        """End what still runs: asked first, then killed; a stopped process cannot hear the asking."""
        left = [process for process in self._started() if process.exitcode is None]
        for process in left:
            process.terminate()
        deadline = time.monotonic() + _GRACE_S
        for process in left:
            process.join(max(0.0, deadline - time.monotonic()))
            if process.exitcode is None:
                process.kill()
        for process in left:
            process.join()

    def _started(self) -> Sequence[ForkServerProcess]:
        return [process for process in self._processes.values() if process.pid is not None]


@contextmanager
def without_main_module() -> Iterator[None]:
    """Hide the main script from `multiprocessing`, which would run it once more in every child.

    What a child needs is preloaded by name; the script (the command line, a test runner) is none of it.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def kind_modules(plan: Plan) -> set[str]:
    """Return the modules of all kinds of a plan, to be loaded once for all; a user's files load in theirs."""
    kinds = [
        plan.plant.kind,
        *(sensor.kind for sensor in plan.sensors),
        *(estimator.kind for estimator in plan.estimators),
        *(stage.kind for stage in plan.stages),
    ]
    locations = {kind.reference.rpartition(":")[0] for kind in kinds}
    return {location for location in locations if not location.endswith(".py")}


def is_stopped(pid: int) -> bool:
    """Return whether a process is stopped by a signal (known on Linux only)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in ("T", "t")
    except OSError:
        return False
