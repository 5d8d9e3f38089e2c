"""The router of a run, which the orchestrator holds."""

from __future__ import annotations

import atexit
import os
import secrets
import shutil
import threading
from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self

import zenoh

from bus.access import Grant
from bus.zenoh.config import ROUTER_RUNTIME, router_config
from bus.zenoh.endpoints import private_directory, with_free_port
from bus.zenoh.session import BusError, open_session, queue_of

_JOIN_S = 5.0


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
        tokens = self._session.liveliness().declare_subscriber("**", queue_of(), history=True)

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
        subscriber = self._session.declare_subscriber(key_expr, queue_of())

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
                session = open_session(config, ROUTER_RUNTIME)
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


def _check_users(grants: Sequence[Grant]) -> None:
    users = [grant.user for grant in grants]
    if not users:
        raise BusError("a router without users would admit everybody: grant something to one user at least")
    if len(set(users)) < len(users):
        raise BusError("two grants name the same user: merge them")
    if unfit := [user for user in users if not user or set(user) & set(":\r\n")]:
        raise BusError(f"a user's name is not empty and holds no colon and no line end: {unfit!r}")
