"""The proof, before a run starts, that the router refuses what was not granted: a refusal raises nothing."""

from __future__ import annotations

import queue
import secrets
from collections.abc import Sequence
from dataclasses import dataclass

from bus.zenoh.client import Client
from bus.zenoh.router import Router
from bus.zenoh.session import BusError, BusTimeout

_FORBIDDEN, _ALLOWED = 0, 1  # subscriptions of a probing client


@dataclass(frozen=True)
class Probe:
    """One user's keys to try: two that it was not granted, and two that it was, as the positive controls."""

    user: str
    forbidden_put: str
    forbidden_subscribe: str
    allowed_put: str
    allowed_subscribe: str


def prove_refusals(router: Router, probes: Sequence[Probe], *, timeout_s: float = 5.0) -> None:
    """Raise `BusError` naming what was not refused, or what was granted and did not arrive.

    Call it before the recorder subscribes, as the probes' messages are real. It takes some 5 ms a probe.
    """
    if probes:
        _prove_password(router, probes[0].user)
    for probe in probes:
        with Client(
            router.endpoint,
            probe.user,
            router.password(probe.user),
            subscribe=(probe.forbidden_subscribe, probe.allowed_subscribe),
            publish=(probe.forbidden_put, probe.allowed_put),
            stall_s=timeout_s,
        ) as client:
            _prove_puts(router, client, probe, timeout_s)
            _prove_subscriptions(router, client, probe, timeout_s)


def _prove_password(router: Router, user: str) -> None:
    try:
        client = Client(router.endpoint, user, secrets.token_urlsafe(24))
    except BusError:
        return
    client.close()
    raise BusError(f"the router admitted {user!r} with a wrong password")


def _prove_puts(router: Router, client: Client, probe: Probe, timeout_s: float) -> None:
    nonce = secrets.token_bytes(8)
    heard: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    forbidden: list[bytes] = []
    endings = [
        router.subscribe(probe.forbidden_put, lambda _, payload: forbidden.append(payload)),
        router.subscribe(probe.allowed_put, lambda _, payload: heard.put(payload)),
    ]
    try:
        client.declare()
        client.put(probe.forbidden_put, nonce)
        client.put(probe.allowed_put, nonce)
        while heard.get(timeout=timeout_s) != nonce:
            pass
    except queue.Empty:
        raise BusError(f"{probe.user!r} may send on {probe.allowed_put!r}, but was refused") from None
    finally:
        for end in endings:
            end()
    # One link keeps order: the allowed message is there, so the one before it was refused or has been
    # delivered.
    if nonce in forbidden:
        raise BusError(f"{probe.user!r} was not refused to send on {probe.forbidden_put!r}")


def _prove_subscriptions(router: Router, client: Client, probe: Probe, timeout_s: float) -> None:
    # The client subscribed before it sent what `_prove_puts` has received: the router knows what it wants.
    # One link keeps order: when the allowed message is there, the forbidden one before it was refused.
    nonce = secrets.token_bytes(8)
    router.put(probe.forbidden_subscribe, nonce)
    router.put(probe.allowed_subscribe, nonce)
    try:
        while client.receive(timeout_s, _ALLOWED)[1] != nonce:
            pass
    except BusTimeout:
        raise BusError(f"{probe.user!r} may hear {probe.allowed_subscribe!r}, but was refused") from None
    while (heard := client.poll(_FORBIDDEN)) is not None:
        if heard[1] == nonce:
            raise BusError(f"{probe.user!r} was not refused to hear {probe.forbidden_subscribe!r}")
