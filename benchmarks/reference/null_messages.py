"""The processes of a bare Zenoh null-message network: messages of the real sizes and order, no mathematics.

Each step `k`

- the plant puts the truth, every sensor answers with a slot;
- the channel turns a sensor's slot into its estimator's correct inbox; the estimator answers with its
  exchange slot;
- the channel, once the slots of all neighbours of a receiver are in, puts its exchange inbox; the estimator
  answers with its estimate;
- the channel puts two events; the recorder, which subscribes to everything, counts, and grants the plant
  further steps.

Nothing is decoded: the step stands at a fixed place of the JSON text, which only the channel and the recorder
read.
"""

import gc
import json
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.synchronize import Event
from typing import Any, NamedTuple

import zenoh

ROOT = "gauntlet/bench"
EVENTS = 2
STEP = slice(8, 16)
BYTES = {
    "truth": 92,
    "slot": 94,
    "correct": 150,
    "exchange_slot": 303,
    "exchange": 1292,
    "estimate": 688,
    "event": 1562,
}
"""Mean sizes in a log of topologies/ding2021/case_b.yaml; those of the two events are averaged."""


class Run(NamedTuple):
    """What every process of one run is told."""

    nodes: int
    steps: int
    window: int
    endpoint: str
    timeout_s: float
    lowlatency: bool
    neighbours: list[list[int]]
    bytes: dict[str, int]

    @property
    def messages_per_step(self) -> int:
        """Messages that the recorder must count for each step."""
        return 1 + 5 * self.nodes + EVENTS


def template(run: Run, kind: str) -> bytes:
    """Return a payload of the kind's size, a JSON object that begins with a place for the step."""
    head, tail = b'{"step":%8d,"values":"', b'"}'
    return head + b"x" * (run.bytes[kind] - len(head % 0) - len(tail)) + tail


def configuration(run: Run, mode: str) -> zenoh.Config:
    """Return a session's configuration: explicit endpoint; nothing that discovers, shares, prioritises."""
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/shared_memory/enabled": False,
        "transport/unicast/max_sessions": 10_000,
        "transport/unicast/accept_pending": 10_000,
        "transport/unicast/lowlatency": run.lowlatency,
        "transport/unicast/qos/enabled": False,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 60_000_000,
        "listen/endpoints" if mode == "router" else "connect/endpoints": [run.endpoint],
    }
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def publisher(session: zenoh.Session, key: str) -> Callable[[bytes], None]:
    """Declare a publisher that waits when the network is congested; return its put."""
    declared = session.declare_publisher(f"{ROOT}/{key}", congestion_control=zenoh.CongestionControl.BLOCK)
    return declared.put


def receiver(run: Run, session: zenoh.Session, key: str) -> Callable[[], zenoh.Sample]:
    """Subscribe through a FIFO channel; return its blocking receive.

    The channel holds all that the window lets be under way: Zenoh's only thread must never wait for it.
    """
    channel: Any = zenoh.handlers.FifoChannel((2 * run.window + 1) * run.messages_per_step)
    return session.declare_subscriber(f"{ROOT}/{key}", channel).recv


@contextmanager
def member(run: Run, name: str, stop: Event) -> Iterator[tuple[zenoh.Session, Callable[[], None]]]:
    """Open a client's session and keep it until the run stops; yield it and what announces its subscriptions.

    The announcement follows the declarations on one link, so the router knows them when the recorder hears of
    it. An alarm ends the process when the run exceeds its time.
    """
    signal.alarm(int(run.timeout_s) + 1)
    gc.disable()
    with zenoh.open(configuration(run, "client")) as session:
        announce = publisher(session, f"ready/{name}")
        yield session, lambda: announce(b"")
        stop.wait(run.timeout_s)


def plant(run: Run, stop: Event) -> None:
    """Put the truth of every step that is granted."""
    payload, granted = template(run, "truth"), 0
    with member(run, "plant", stop) as (session, ready):
        credit, put = receiver(run, session, "credit"), publisher(session, "run/truth/plant")
        ready()
        for step in range(run.steps):
            while step >= granted:
                granted = int(credit().payload.to_bytes())
            put(payload % step)


def sensor(run: Run, stop: Event, i: int) -> None:
    """Answer every truth with a slot."""
    payload = template(run, "slot")
    with member(run, f"s{i}", stop) as (session, ready):
        truth, put = receiver(run, session, "run/truth/plant"), publisher(session, f"run/tx/s{i}")
        ready()
        for step in range(run.steps):
            truth()
            put(payload % step)


def estimator(run: Run, stop: Event, i: int) -> None:
    """Answer the correct inbox with an exchange slot, and the exchange inbox with an estimate."""
    slot, estimate = template(run, "exchange_slot"), template(run, "estimate")
    with member(run, f"e{i}", stop) as (session, ready):
        correct = receiver(run, session, f"run/rx/e{i}/correct")
        exchange = receiver(run, session, f"run/rx/e{i}/exchange")
        put_slot = publisher(session, f"run/tx/e{i}/exchange")
        put_estimate = publisher(session, f"run/estimate/e{i}")
        ready()
        for step in range(run.steps):
            correct()
            put_slot(slot % step)
            exchange()
            put_estimate(estimate % step)


def channel(run: Run, stop: Event) -> None:
    """Turn slots into inboxes: a sensor's at once, the neighbours' when the last one is in."""
    correct, exchange, event = template(run, "correct"), template(run, "exchange"), template(run, "event")
    missing: dict[int, list[int]] = {}
    degrees = [len(near) for near in run.neighbours]
    with member(run, "channel", stop) as (session, ready):
        receive = receiver(run, session, "run/tx/**")
        put_correct = [publisher(session, f"run/rx/e{i}/correct") for i in range(run.nodes)]
        put_exchange = [publisher(session, f"run/rx/e{i}/exchange") for i in range(run.nodes)]
        put_event = publisher(session, "run/channel/events")
        senders = {f"{ROOT}/run/tx/s{i}": (True, i) for i in range(run.nodes)}
        senders |= {f"{ROOT}/run/tx/e{i}/exchange": (False, i) for i in range(run.nodes)}
        ready()
        for _ in range(2 * run.nodes * run.steps):
            sample = receive()
            is_sensor, i = senders[str(sample.key_expr)]
            step = int(sample.payload.to_bytes()[STEP])
            if is_sensor:
                put_correct[i](correct % step)
                continue
            waits = missing.setdefault(step, [*degrees, run.nodes])
            for j in run.neighbours[i]:
                waits[j] -= 1
                if not waits[j]:
                    put_exchange[j](exchange % step)
            waits[-1] -= 1
            if not waits[-1]:
                del missing[step]
                for _ in range(EVENTS):
                    put_event(event % step)


class Recorder:
    """Counts every message, grants steps to the plant, and notes when the first and last step were complete.

    A step is complete when all of its estimates are here; the run is, when all messages of all steps are.
    """

    def __init__(self, run: Run, session: zenoh.Session) -> None:
        self.run = run
        self.batch = max(1, run.window // 2)
        self.estimates = [0] * run.steps
        self.count = self.complete = 0
        self.first_s = self.last_s = 0.0
        self.credit = publisher(session, "credit")
        self.receive = receiver(run, session, "run/**")
        self.receive_ready = receiver(run, session, "ready/*")

    def wait_for_all(self) -> None:
        """Wait until all processes have subscribed."""
        for _ in range(2 * self.run.nodes + 2):
            self.receive_ready()

    def record(self) -> None:
        """Grant the first steps, and count until every message of every step is here."""
        self.credit(b"%d" % self.run.window)
        for _ in range(self.run.steps * self.run.messages_per_step):
            sample = self.receive()
            self.count += 1
            if "/estimate/" in str(sample.key_expr):
                self.on_estimate(int(sample.payload.to_bytes()[STEP]))
        self.last_s = time.monotonic()

    def on_estimate(self, step: int) -> None:
        """Note an estimate; grant further steps every so many complete ones."""
        self.estimates[step] += 1
        if self.estimates[step] < self.run.nodes:
            return
        self.complete += 1
        if self.complete == 1:
            self.first_s = time.monotonic()
        if self.complete % self.batch == 0:
            self.credit(b"%d" % (self.complete + self.run.window))
