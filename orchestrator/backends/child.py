"""What a child process of a run does: it keeps its own log, watches its parent, and runs its programs."""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Sequence
from multiprocessing import connection, parent_process
from pathlib import Path

from bus.grants import CHANNEL, inputs
from bus.plan import Plan
from bus.process import Membership, run_process
from bus.program import Port, Program
from channel.program import channel_programs
from nodes.build import node_program

_EXTERNAL = "nodes.estimators.external:External"
_PR_SET_PDEATHSIG = 1


def child_main(pickled_plan: bytes, own: Membership, log_file: Path) -> None:
    """Run one process to its end and leave: with code 0, or 1 after writing a traceback to its log file."""
    redirect_output(log_file)
    print(f"{own.name}: process {os.getpid()}", flush=True)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the orchestrator's to handle
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    leave_with_parent()

    def build(port: Port) -> Sequence[tuple[Program, Sequence[str]]]:
        if own.name == CHANNEL:
            return channel_programs(port, plan)
        return [(node_program(port, plan, own.name, own.window), inputs(plan, own.name))]

    try:
        plan = pickle.loads(pickled_plan)
        command = external_command(plan, own.name)
        if command is not None:
            _become(command, plan, own)
        run_process(plan, own, build)
        if any(fault.node == own.name for fault in plan.faults):
            os.kill(os.getpid(), signal.SIGKILL)  # the crash that the plan schedules
        code = 0
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # the bus's own threads may outlive a failed session and hold a normal exit up for ever


def external_command(plan: Plan, name: str) -> list[str] | None:
    """Return the command of an external node, None for a node of ours."""
    for estimator in plan.estimators:
        if estimator.name == name and estimator.kind.reference == _EXTERNAL:
            return list(estimator.kind.parameters["command"])
    return None


def _become(command: list[str], plan: Plan, own: Membership) -> None:
    """Replace this process by a user's program, which is told in its environment how to join the bus."""
    if (
        sys.platform == "linux"
    ):  # the thread that watches the parent does not survive, so the kernel must watch
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    membership = {
        "GAUNTLET_ENDPOINT": own.endpoint,
        "GAUNTLET_RUN": own.run,
        "GAUNTLET_NODE": own.name,
        "GAUNTLET_PASSWORD": own.password,
        "GAUNTLET_STEPS": str(plan.steps),
        "GAUNTLET_PERIOD_S": repr(plan.period_s),
    }
    os.execvpe(command[0], command, {**os.environ, **membership})


def redirect_output(log_file: Path, *, append: bool = False) -> None:
    """Send standard output and error, where warnings go too, to the process's log file."""
    how = os.O_APPEND if append else os.O_TRUNC
    descriptor = os.open(log_file, os.O_WRONLY | os.O_CREAT | how, 0o644)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)


def leave_with_parent(*, with_group: bool = False) -> None:
    """See to it that this process ends as soon as its parent is gone, however it went.

    With ``with_group``, the group of processes that it leads ends with it.
    """
    threading.Thread(target=_await_parents_end, args=(with_group,), daemon=True).start()


def _await_parents_end(with_group: bool) -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        if with_group:
            os.killpg(0, signal.SIGKILL)
        os._exit(1)
