"""A ring of nodes with feedback each step on HELICS 3, one process a federate.

    python benchmarks/reference/helics_ring.py --nodes 20 --steps 300

A broker (the `helics_broker` program of the wheel) and one value federate a node, each with a zmq core of its
own. What was chosen so that HELICS runs as fast as it can:

- a period of one step and uninterruptible time requests: each federate asks for exactly the next step;
- what is published at one step is read at the next, so the feedback needs no iteration;
- global double publications, read as numbers; no logging in federates, cores and broker;
- federates are forked from a process that has loaded HELICS, where users start an interpreter for each;
- zmq, HELICS' default core: with these options its other network cores hung or were slower.
"""

import argparse
import multiprocessing
import os
import socket
import subprocess
import sys
import time
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import ModuleType
from typing import Any

from ring import agrees, neighbours, report, update

CORE = "zmq"
QUIET = "--loglevel=no_print --consoleloglevel=no_print"


def free_port() -> int:
    """Return a port of the loopback interface that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def start_broker(nodes: int, port: int) -> "subprocess.Popen[bytes]":
    """Start the broker program that the wheel of HELICS carries."""
    import helics

    program = Path(helics.__file__).parent / "install" / "bin" / "helics_broker"
    command = [str(program), f"--federates={nodes}", f"--coretype={CORE}", f"--port={port}", *QUIET.split()]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL)


def create_federate(helics: ModuleType, node: int, port: int) -> Any:
    """Create the federate of one node, connected to the broker by a core of its own."""
    info = helics.helicsCreateFederateInfo()
    helics.helicsFederateInfoSetCoreTypeFromString(info, CORE)
    helics.helicsFederateInfoSetCoreInitString(info, f"--federates=1 --brokerport={port} {QUIET}")
    helics.helicsFederateInfoSetTimeProperty(info, helics.HELICS_PROPERTY_TIME_PERIOD, 1.0)
    helics.helicsFederateInfoSetFlagOption(info, helics.HELICS_FLAG_UNINTERRUPTIBLE, True)
    return helics.helicsCreateValueFederate(f"node{node}", info)


def run_federate(node: int, nodes: int, steps: int, port: int, results: Connection) -> None:
    """Run one node; send its final value and when it started, did its first step and did its last."""
    import helics

    federate = create_federate(helics, node, port)
    publication = helics.helicsFederateRegisterGlobalPublication(
        federate, f"value{node}", helics.HELICS_DATA_TYPE_DOUBLE, ""
    )
    near = neighbours(node, nodes)
    inputs = [helics.helicsFederateRegisterSubscription(federate, f"value{j}", "") for j in near]
    for given in inputs:
        helics.helicsInputSetDefaultDouble(given, 0.0)
    helics.helicsFederateEnterExecutingMode(federate)
    times, value = [time.monotonic()], 0.0
    for step in range(steps):
        value = update(step, node, map(helics.helicsInputGetDouble, inputs))
        helics.helicsPublicationPublishDouble(publication, value)
        helics.helicsFederateRequestTime(federate, float(step + 1))
        times.append(time.monotonic())
    helics.helicsFederateDisconnect(federate)
    results.send((value, times[0], times[1], times[-1]))
    helics.helicsFederateFree(federate)
    helics.helicsCloseLibrary()


def start_federates(nodes: int, steps: int, port: int) -> dict[Connection, Any]:
    """Fork the federates from a process that has HELICS loaded; return them by their pipes of results."""
    os.environ["PYTHONPATH"] = str(Path(__file__).resolve().parent)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["helics", "helics_ring"])
    processes = {}
    for node in range(nodes):
        receiver, sender = context.Pipe(duplex=False)
        arguments = (node, nodes, steps, port, sender)
        process = context.Process(target=run_federate, args=arguments, daemon=True)
        process.start()
        sender.close()
        processes[receiver] = process
    return processes


def collect(processes: dict[Connection, Any], timeout_s: float) -> list[tuple[float, float, float, float]]:
    """Return the federates' results in node order; raise TimeoutError or, for a dead one, EOFError."""
    end_s = time.monotonic() + timeout_s
    found: dict[Connection, tuple[float, float, float, float]] = {}
    while len(found) < len(processes):
        ready = wait([pipe for pipe in processes if pipe not in found], end_s - time.monotonic())
        if not ready:
            raise TimeoutError(f"{len(processes) - len(found)} federates are not done after {timeout_s} s")
        found.update({pipe: pipe.recv() for pipe in ready if isinstance(pipe, Connection)})
    return [found[pipe] for pipe in processes]


def simulate(nodes: int, steps: int, timeout_s: float, since_s: float) -> str:
    """Run the ring once and return its JSON line; leave no process behind."""
    port = free_port()
    broker = start_broker(nodes, port)
    processes: dict[Connection, Any] = {}
    try:
        processes = start_federates(nodes, steps, port)
        values, started, first, last = zip(*collect(processes, timeout_s), strict=True)
        for process in processes.values():
            process.join(5.0)
    finally:
        for process in processes.values():
            process.kill()
        broker.kill()
        broker.wait(5.0)
    run_s = max(last) - min(started)
    checked = agrees(values, steps)
    return report("helics zmq", nodes, steps, start_up_s=max(first) - since_s, run_s=run_s, checked=checked)


def main() -> None:
    """Read the command line and run the ring."""
    entered_s = time.monotonic()
    parser = argparse.ArgumentParser(description="A ring with feedback each step on HELICS.")
    parser.add_argument("--nodes", type=int, default=20)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--timeout", type=float, default=300.0, help="seconds after which to give up")
    parser.add_argument(
        "--since", type=float, help="monotonic time from which the start-up counts; default: now"
    )
    options = parser.parse_args()
    since_s = entered_s if options.since is None else options.since
    line = simulate(options.nodes, options.steps, options.timeout, since_s)
    sys.stdout.write(line + "\n")


if __name__ == "__main__":
    main()
