"""Where a router listens, and the moment at which a process picks its threads."""

from __future__ import annotations

import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

_LONGEST_PARENT = 107 - len("/gauntlet-12345678/bus.lock")  # bytes; a Unix socket's path ends at 107


def private_directory() -> str:
    """Make a directory that only this user may enter (0700), its path short enough for a socket's."""
    parent = tempfile.gettempdir()
    if len(os.fsencode(parent)) > _LONGEST_PARENT:
        parent = "/tmp"
    return tempfile.mkdtemp(prefix="gauntlet-", dir=parent)


def with_free_port(endpoint: str) -> str:
    """Replace port 0 by a free one of the loopback interface: Zenoh would not tell which one it took."""
    if not endpoint.endswith(":0"):
        return endpoint
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return f"{endpoint[:-1]}{probe.getsockname()[1]}"


@contextmanager
def environment(name: str, value: str) -> Iterator[None]:
    """Set a variable for a moment, unless the user did: child processes must not inherit it."""
    if name in os.environ:
        yield
        return
    os.environ[name] = value
    try:
        yield
    finally:
        del os.environ[name]
