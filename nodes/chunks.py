"""Long arrays are worked on a chunk at a time: it fits the cache, and is not asked for anew in every call."""

from __future__ import annotations

from functools import lru_cache

CHUNK = 2048
"""Entries at a time. Larger temporary arrays go back to the system and cost a page fault every 4 KiB."""


@lru_cache(maxsize=64)
def chunks(size: int) -> tuple[slice, ...]:
    """Return the slices that cut ``size`` entries into chunks, in order."""
    return tuple(slice(begin, min(begin + CHUNK, size)) for begin in range(0, size, CHUNK))
