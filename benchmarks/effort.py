"""How much a benchmark may take, and where it tells what it is doing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """``repeats`` runs of everything, their steps multiplied by ``scale``, none longer than ``timeout_s``."""

    repeats: int = 5
    scale: float = 1.0
    timeout_s: float = 180.0
    tell: Callable[[str], None] = lambda text: None

    def steps(self, full: int) -> int:
        """Return the number of steps to take where a full benchmark takes so many."""
        return max(40, round(full * self.scale))
