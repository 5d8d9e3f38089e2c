"""A bare Zenoh null-message network of the shape of the main topology: the pace that the transport allows.

    python benchmarks/reference/bare_zenoh.py --nodes 20 --steps 300 --window 16

One plant, N sensors, N estimators, one channel, and the recorder in the process that holds the router:
2 N + 3 processes. What they put is told in `null_messages.py`. No access control, no credentials. What was
chosen, after measuring the alternatives, so that Zenoh runs as fast as it can:

- clients of one router on Unix sockets; no scouting, gossip, shared memory or QoS;
- the batching transport: with `--lowlatency` each message is a write of its own, at up to twice the cost;
- one thread for all of a client's Zenoh runtimes. The router keeps Zenoh's own threads: when its receiving
  runtime shares a thread with others, a congested link stops the whole network for ever;
- receivers block in a FIFO channel without the interpreter's lock, in the main thread; no callback;
- declared publishers with `CongestionControl.BLOCK`; payloads made before the run, but for the step;
- processes forked from a server that has loaded numpy and zenoh; no garbage collection in them.
"""

import argparse
import json
import multiprocessing
import os
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import zenoh
from null_messages import BYTES, Recorder, Run, channel, configuration, estimator, plant, sensor
from usage import cpu_s, memory_mb

TCP = "tcp/127.0.0.1:7448"
NODE_RUNTIME = "(rx: (handover: app), acc: (handover: app), net: (handover: app), tx: (handover: app))"


def random_geometric(nodes: int, seed: int) -> list[list[int]]:
    """Return each node's neighbours in a connected random geometric graph.

    The points are those of `networkx.random_geometric_graph`; the radius is 0.35 at 20 nodes and keeps the
    mean degree elsewhere.
    """
    radius = 0.35 * (20 / nodes) ** 0.5
    for attempt in range(seed, seed + 1000):
        random = Random(attempt)
        at = [complex(random.random(), random.random()) for _ in range(nodes)]
        near = [[j for j in range(nodes) if j != i and abs(at[i] - at[j]) <= radius] for i in range(nodes)]
        reached, frontier = {0}, [0]
        while frontier:
            fresh = set(near[frontier.pop()]) - reached
            reached |= fresh
            frontier += fresh
        if len(reached) == nodes:
            return near
    raise ValueError(f"no connected graph of {nodes} nodes; use --graph ring")


def ring(nodes: int) -> list[list[int]]:
    """Return each node's two neighbours on either side of a ring."""
    return [sorted({(i + offset) % nodes for offset in (-2, -1, 1, 2)} - {i}) for i in range(nodes)]


@contextmanager
def forked(run: Run) -> Iterator[list[int]]:
    """Fork every process but this one; yield their ids, then stop them, or kill what does not stop."""
    os.environ["ZENOH_RUNTIME"] = NODE_RUNTIME
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    os.environ["PYTHONPATH"] = str(Path(__file__).resolve().parent)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["numpy", "null_messages", "bare_zenoh"])
    stop = context.Event()
    work: list[tuple[Callable[..., None], tuple[int, ...]]] = [(plant, ()), (channel, ())]
    work += [(sensor, (i,)) for i in range(run.nodes)] + [(estimator, (i,)) for i in range(run.nodes)]
    processes = [context.Process(target=role, args=(run, stop, *which), daemon=True) for role, which in work]
    try:
        for process in processes:
            process.start()
        yield [process.pid for process in processes if process.pid]
        stop.set()
        for process in processes:
            process.join(5.0)
    finally:
        for process in processes:
            if process.pid:
                process.kill()


def simulate(run: Run, since_s: float) -> dict[str, object]:
    """Run the network once and return its figures; the rate is that from the first whole step to the last."""
    with zenoh.open(configuration(run, "router")) as session:
        recorder = Recorder(run, session)
        with forked(run) as pids:
            everyone = [os.getpid(), *pids]
            recorder.wait_for_all()
            cpu_before_s = cpu_s(everyone)
            recorder.record()
            cpu_per_step_s = (cpu_s(everyone) - cpu_before_s) / run.steps
            memory = memory_mb(everyone)
    return {
        "processes": len(everyone),
        "mean_degree": round(statistics.mean(map(len, run.neighbours)), 2),
        "steps_per_s": round((run.steps - 1) / (recorder.last_s - recorder.first_s), 1),
        "start_up_s": round(recorder.first_s - since_s, 3),
        "cpu_ms_per_step": round(1e3 * cpu_per_step_s, 2),
        "messages": recorder.count,
        **memory,
    }


def give_up(signal_number: int, frame: object) -> None:
    """End a run that exceeds its time, stopping its processes; a second alarm ends a stuck session."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(5)
    raise TimeoutError("the run did not end in time")


def parse() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description="A bare Zenoh null-message network.")
    parser.add_argument("--nodes", type=int, default=20)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--window", type=int, default=16, help="steps that the plant may lead")
    parser.add_argument("--graph", choices=["geometric", "ring"], default="geometric")
    parser.add_argument("--seed", type=int, default=1, help="seed of the geometric graph")
    parser.add_argument(
        "--shape",
        type=Path,
        help="JSON file of 'window', each node's 'neighbours', and the 'bytes' of messages",
    )
    parser.add_argument(
        "--since", type=float, help="monotonic time from which the start-up counts; default: now"
    )
    parser.add_argument("--transport", choices=["unixsock", "tcp"], default="unixsock")
    parser.add_argument("--lowlatency", action="store_true", help="Zenoh's transport without batches")
    parser.add_argument("--timeout", type=int, default=120, help="seconds after which to give up")
    return parser.parse_args()


def shape_of(asked: argparse.Namespace) -> tuple[int, list[list[int]], dict[str, int]]:
    """Return the window, each node's neighbours and the size of each kind of message."""
    if asked.shape:
        stated = json.loads(asked.shape.read_text())
        return stated["window"], stated["neighbours"], stated["bytes"]
    near = ring(asked.nodes) if asked.graph == "ring" else random_geometric(asked.nodes, asked.seed)
    return asked.window, near, BYTES


def main() -> None:
    """Run the network once and print its JSON line."""
    entered_s = time.monotonic()
    asked = parse()
    signal.signal(signal.SIGALRM, give_up)
    signal.alarm(asked.timeout)
    window, near, sizes = shape_of(asked)
    nodes = len(near)
    with tempfile.TemporaryDirectory() as folder:
        endpoint = f"unixsock-stream/{folder}/router" if asked.transport == "unixsock" else TCP
        run = Run(nodes, asked.steps, window, endpoint, asked.timeout, asked.lowlatency, near, sizes)
        figures = simulate(run, entered_s if asked.since is None else asked.since)
    shape = {"reference": "bare zenoh", "nodes": nodes, "steps": asked.steps, "window": window}
    sys.stdout.write(json.dumps(shape | figures) + "\n")


if __name__ == "__main__":
    main()
