"""The bus of a run of many processes: a router in the orchestrator, one client a process.

Only this file imports Zenoh. Callbacks only hand over, because Zenoh prints and swallows what is raised in
one. Every wait has a deadline. Start a run only when `Router.wait_alive` has seen everybody: what is sent
before its subscriber is there is lost.
"""

from __future__ import annotations

import atexit
import math
import os
import secrets
import shutil
import threading
import time
from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import zenoh

from bus.access import Grant
from bus.endpoints import environment, private_directory, with_free_port
from bus.zenoh_config import CLIENT_RUNTIME, ROUTER_RUNTIME, RUNTIME_VARIABLE, client_config, router_config

_BACKLOG = 4096  # messages that a subscription holds before their senders wait
_LONGEST_POLL_S = 0.01
_JOIN_S = 5.0


class BusError(RuntimeError):
    """The bus cannot do what was asked; the message tells the cure."""


class BusTimeout(BusError):  # noqa: N818 - the name says what happened
    """Nothing came before the deadline."""


class Router:
    """The router of a run, held by the orchestrator: it admits known users and enforces their grants.

    What it subscribes to and sends itself is not limited, and it does not hear itself.

    A receiver that stops (SIGSTOP, a debugger) is sent about 1.1 MB more. Then its senders wait inside the
    router, and in the worst case everybody with them, until it goes on; nothing is lost. Keep what the run's
    window lets one process fall behind well below that.

    Parameters
    ----------
    grants
        One for every user that may connect; at least one.
    listen
        A Zenoh endpoint. By default a Unix socket in a new directory that only this user may enter, removed
        on `close`. ``tcp/127.0.0.1:0`` takes a free port.
    stall_s
        The run's stall deadline in seconds; a stopped process keeps its link for four of them.
    on_gone
        Called with the liveliness key of a client that left or died, from another thread: it may only
        enqueue.
    """

    def __init__(
        self,
        grants: Sequence[Grant],
        *,
        listen: str | None = None,
        stall_s: float = 30.0,
        on_gone: Callable[[str], None] | None = None,
    ) -> None:
        _check_users(grants)
        self.stall_s = stall_s
        self._passwords = {grant.user: secrets.token_urlsafe(24) for grant in grants}
        self._alive: set[str] = set()
        self._changed = threading.Condition()
        self._on_gone = on_gone
        self._feeders: list[threading.Thread] = []
        self._leftovers = ExitStack()
        self._session = self._open(grants, listen)
        atexit.register(self.close)
        tokens = self._session.liveliness().declare_subscriber("**", _channel(), history=True)

        def note_tokens() -> None:
            for token in tokens.handler:
                self._note_token(token)

        self._feed(note_tokens)

    def password(self, user: str) -> str:
        """Return the password drawn for `user` in this run."""
        return self._passwords[user]

    def subscribe(self, key_expr: str, deliver: Callable[[str, bytes], None]) -> Callable[[], None]:
        """Call `deliver(key, payload)` for every message, in order, from one thread; return what ends it.

        `deliver` must not raise: its thread would end and the senders would stall. Ending the subscription
        returns when all that had arrived is delivered.
        """
        subscriber = self._session.declare_subscriber(key_expr, _channel())

        def run() -> None:
            for sample in subscriber.handler:
                deliver(str(sample.key_expr), sample.payload.to_bytes())

        feeder = self._feed(run)

        def end() -> None:
            subscriber.undeclare()  # type: ignore[no-untyped-call]
            feeder.join(_JOIN_S)

        return end

    def put(self, key: str, payload: bytes) -> None:
        """Send one message to the clients; waits while a receiver's queue is full."""
        self._session.put(
            key,
            payload,
            congestion_control=zenoh.CongestionControl.BLOCK,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    def tell_self(self, key: str, payload: bytes) -> None:
        """Put a message behind all those that have come so far, for the router's own subscription alone."""
        self._session.put(key, payload, allowed_destination=zenoh.Locality.SESSION_LOCAL)

    def wait_alive(self, keys: Collection[str], timeout_s: float) -> set[str]:
        """Wait until the clients have announced themselves with all of `keys`; return the missing ones."""
        wanted = frozenset(keys)
        with self._changed:
            self._changed.wait_for(lambda: wanted <= self._alive, timeout_s)
            return set(wanted - self._alive)

    def wait_gone(self, key: str, timeout_s: float) -> bool:
        """Wait until the link of the client that announced itself with `key` has ended; return whether."""
        with self._changed:
            return self._changed.wait_for(lambda: key not in self._alive, timeout_s)

    def close(self) -> None:
        """End all links and remove the socket; a second call does nothing."""
        atexit.unregister(self.close)
        self._on_gone = None
        self._session.close()  # type: ignore[no-untyped-call]
        for feeder in self._feeders:
            feeder.join(_JOIN_S)
        self._leftovers.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self, grants: Sequence[Grant], listen: str | None) -> zenoh.Session:
        with ExitStack() as leftovers:
            directory = private_directory()
            leftovers.callback(shutil.rmtree, directory, ignore_errors=True)
            self.endpoint = with_free_port(listen) if listen else f"unixsock-stream/{directory}/bus"
            users = Path(directory) / "users"
            lines = [f"{user}:{password}\n" for user, password in self._passwords.items()]
            with open(os.open(users, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
                file.writelines(lines)
            config = router_config(self.endpoint, grants, str(users), self.stall_s)
            try:
                session = _open(config, ROUTER_RUNTIME)
            except zenoh.ZError as error:
                raise BusError(f"cannot listen on {self.endpoint}: does another run use it?") from error
            users.unlink()  # it is read once, at the start: no password stays on the disk
            if listen is None:
                self._leftovers = leftovers.pop_all()
        return session

    def _note_token(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        gone = sample.kind == zenoh.SampleKind.DELETE
        with self._changed:
            (self._alive.discard if gone else self._alive.add)(key)
            self._changed.notify_all()
        on_gone = self._on_gone
        if gone and on_gone is not None:
            on_gone(key)

    def _feed(self, empty: Callable[[], None]) -> threading.Thread:
        # Zenoh's receiving threads fill its own channel without the interpreter's lock, and a daemon thread
        # empties it. A callback in them would hold up everybody's traffic while the orchestrator computes: it
        # took twice the CPU and halved the steps per second. The thread that Zenoh would start for one is no
        # daemon: a session left open would keep the interpreter for ever.
        feeder = threading.Thread(target=empty, name="bus", daemon=True)
        feeder.start()
        self._feeders.append(feeder)
        return feeder


class Client:
    """One process's link to the router: sends on the keys it names, and receives from what it subscribes to.

    Construction dials once, and raises `BusError` within milliseconds if the router refuses or is not there.
    A client does not hear itself. If its owner forgets to close it, it is closed at exit: an open session can
    keep an interpreter for ever. A process that cannot unwind should leave with ``os._exit``.

    Parameters
    ----------
    subscribe, publish
        Key expressions to receive from, each with a queue of its own, and keys to send on; `announce`
        declares them.
    backlog
        Messages that a queue holds. Zenoh's receiving thread fills it without the interpreter's lock; when it
        is full, that thread waits, and with it all else that comes: let it hold whatever may be under way.
    stall_s
        The run's stall deadline in seconds.
    """

    def __init__(
        self,
        endpoint: str,
        user: str,
        password: str,
        *,
        subscribe: Sequence[str] = (),
        publish: Sequence[str] = (),
        backlog: int = _BACKLOG,
        stall_s: float = 30.0,
    ) -> None:
        self.user = user
        self._subscribe, self._publish = tuple(subscribe), tuple(publish)
        self._backlog = backlog
        self._stall_s = stall_s
        self._subscribers: list[zenoh.Subscriber[Any]] = []
        self._channels: list[zenoh.Handler[zenoh.Sample]] = []
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._router_gone = False
        self._deadline = math.inf
        self._look = threading.Event()
        self._closing = False
        try:
            self._session = _open(client_config(endpoint, user, password, stall_s), CLIENT_RUNTIME)
        except zenoh.ZError as error:
            raise BusError(
                f"the router at {endpoint} does not admit {user!r}: it is not running, or user and password "
                "are not of this run"
            ) from error
        atexit.register(self.close)
        listener = _direct(self._note_transport)
        self._kept: list[object] = [self._session.info.declare_transport_events_listener(listener)]
        threading.Thread(target=self._watch, name="bus", daemon=True).start()

    def announce(self, key: str) -> None:
        """Declare everything, then the liveliness token `key`: who sees it may rely on the subscriptions.

        Raises `BusTimeout` if after a stall deadline nobody subscribes to something that this client sends.
        """
        self.declare()
        self._kept.append(self._session.liveliness().declare_token(key))

    def declare(self) -> None:
        """Declare subscriptions and publishers, and wait until every publisher knows of a subscriber.

        Without the wait, a client keeps back what it believes that nobody hears.
        """
        for key_expr in self._subscribe:
            channel: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(self._backlog)
            subscriber = self._session.declare_subscriber(
                key_expr, channel, allowed_origin=zenoh.Locality.REMOTE
            )
            self._subscribers.append(subscriber)
            self._channels.append(subscriber.handler)
        for key in self._publish:
            self._publishers[key] = self._session.declare_publisher(
                key,
                congestion_control=zenoh.CongestionControl.BLOCK,
                reliability=zenoh.Reliability.RELIABLE,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        self._wait_for_subscribers()

    def put(self, key: str, payload: bytes) -> None:
        """Send one message on a key that was named; waits while the way is full, and never drops.

        A key that the router refuses raises nothing here. Python's signal handlers wait for the end of a wait
        inside.
        """
        if self._router_gone:
            raise BusError(f"{self.user}: the router is gone, the run is over")
        publisher = self._publishers.get(key)
        if publisher is None:
            raise BusError(f"{self.user} has not declared {key!r}: name it in 'publish' and announce first")
        publisher.put(payload)

    def receive(self, timeout_s: float, subscription: int = 0) -> tuple[str, bytes]:
        """Return the next message of a subscription (its place in ``subscribe``) as (key, payload).

        Raises `BusTimeout` within a second after `timeout_s` seconds; the subscriptions are over then. Raises
        `BusError` within milliseconds of the router's end, once all that had come before is received.
        """
        sample = self._next(timeout_s, subscription)
        return str(sample.key_expr), sample.payload.to_bytes()

    def take(self, timeout_s: float, subscription: int) -> bytes:
        """Like `receive`, but return the payload alone, for a subscription to one key."""
        return self._next(timeout_s, subscription).payload.to_bytes()

    def poll(self, subscription: int = 0) -> tuple[str, bytes] | None:
        """Return the next message of a subscription if it is here already."""
        sample = self._channels[subscription].try_recv()
        return None if sample is None else (str(sample.key_expr), sample.payload.to_bytes())

    def close(self) -> None:
        """Withdraw the token and end the link; a second call does nothing."""
        atexit.unregister(self.close)
        self._closing = True
        self._look.set()
        self._session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _next(self, timeout_s: float, subscription: int) -> zenoh.Sample:
        self._deadline = time.monotonic() + timeout_s
        try:
            sample = self._channels[subscription].recv()
        except zenoh.ZError:
            if self._router_gone:
                raise BusError(f"{self.user}: the router is gone, the run is over") from None
            raise BusTimeout(f"{self.user} received nothing for {timeout_s:g} s") from None
        self._deadline = math.inf
        return sample

    def _note_transport(self, event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.DELETE:
            self._router_gone = True
            self._look.set()

    def _watch(self) -> None:
        """End the subscriptions when a deadline has passed or the router is gone, which wakes who receives.

        A wait in Zenoh's channel costs a third less than one in a queue of Python's, but knows no deadline.
        """
        while not self._closing:
            if self._router_gone or time.monotonic() > self._deadline:
                for subscriber in self._subscribers:
                    subscriber.undeclare()  # type: ignore[no-untyped-call]
                return
            self._look.wait(min(1.0, max(0.0, self._deadline - time.monotonic())))
            self._look.clear()

    def _wait_for_subscribers(self) -> None:
        deadline, pause_s = time.monotonic() + self._stall_s, _LONGEST_POLL_S / 16
        unheard = self._publishers
        while unheard := {key: publisher for key, publisher in unheard.items() if not _is_heard(publisher)}:
            if time.monotonic() > deadline:
                raise BusTimeout(f"{self.user}: nobody subscribes to {', '.join(unheard)}")
            time.sleep(pause_s)
            pause_s = min(2 * pause_s, _LONGEST_POLL_S)


def _open(config: str, runtime: str) -> zenoh.Session:
    with environment(RUNTIME_VARIABLE, runtime):
        return zenoh.open(zenoh.Config.from_json5(config))


def _direct(callback: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Call back in Zenoh's receiving thread: a thread less to wake, and none to end at exit."""
    return zenoh.handlers.Callback(callback, indirect=False)


def _channel() -> zenoh.handlers.FifoChannel[zenoh.Sample]:
    return zenoh.handlers.FifoChannel(_BACKLOG)


def _is_heard(publisher: zenoh.Publisher) -> bool:
    status: Any = publisher.matching_status  # the stub says bool, but it is an object, and always true
    return bool(status.matching)


def _check_users(grants: Sequence[Grant]) -> None:
    users = [grant.user for grant in grants]
    if not users:
        raise BusError("a router without users would admit everybody: grant something to one user at least")
    if len(set(users)) < len(users):
        raise BusError("two grants name the same user: merge them")
    if unfit := [user for user in users if not user or set(user) & set(":\r\n")]:
        raise BusError(f"a user's name is not empty and holds no colon and no line end: {unfit!r}")
