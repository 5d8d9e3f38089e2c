"""One process's link to the router."""

from __future__ import annotations

import atexit
import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Self

import zenoh

from bus.zenoh.config import CLIENT_RUNTIME, client_config
from bus.zenoh.session import BACKLOG, BusError, BusTimeout, open_session, queue_of

_LONGEST_POLL_S = 0.01


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
        backlog: int = BACKLOG,
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
            self._session = open_session(client_config(endpoint, user, password, stall_s), CLIENT_RUNTIME)
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
            subscriber = self._session.declare_subscriber(
                key_expr, queue_of(self._backlog), allowed_origin=zenoh.Locality.REMOTE
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


def _direct(callback: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Call back in Zenoh's receiving thread: a thread less to wake, and none to end at exit."""
    return zenoh.handlers.Callback(callback, indirect=False)


def _is_heard(publisher: zenoh.Publisher) -> bool:
    status: Any = publisher.matching_status  # the stub says bool, but it is an object, and always true
    return bool(status.matching)
