"""Who may say and hear what on the bus."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Grant:
    """What one user of the bus may do; whatever is not granted is refused."""

    user: str
    may_put: tuple[str, ...]
    """Key expressions this user may publish on."""
    may_subscribe: tuple[str, ...]
    """Key expressions this user may subscribe to and be delivered."""
    alive: str
    """The liveliness key it may declare."""
