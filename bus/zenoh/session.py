"""What router and client share: how a session is opened, what a subscription holds, what can go wrong."""

from __future__ import annotations

import zenoh

from bus.zenoh.config import RUNTIME_VARIABLE
from bus.zenoh.endpoints import environment

BACKLOG = 4096
"""Messages that a subscription holds before their senders wait."""


class BusError(RuntimeError):
    """The bus cannot do what was asked; the message tells the cure."""


class BusTimeout(BusError):  # noqa: N818 - the name says what happened
    """Nothing came before the deadline."""


def open_session(config: str, runtime: str) -> zenoh.Session:
    """Open a session of a configuration (JSON5), whose threads are those of ``runtime``."""
    with environment(RUNTIME_VARIABLE, runtime):
        return zenoh.open(zenoh.Config.from_json5(config))


def queue_of(size: int = BACKLOG) -> zenoh.handlers.FifoChannel[zenoh.Sample]:
    """Return the queue of a subscription, which Zenoh's threads fill without the interpreter's lock."""
    return zenoh.handlers.FifoChannel(size)
