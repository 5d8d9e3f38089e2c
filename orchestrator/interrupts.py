"""Ctrl-C and SIGTERM as one exception, raised once, and never in the middle of writing."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final


class Interrupted(BaseException):
    """The run was asked to end by a signal."""

    def __init__(self, signal_number: int) -> None:
        super().__init__(signal.Signals(signal_number).name)
        self.exit_code = 128 + signal_number


class _Uninterrupted:
    """A context that a signal does not break into: `Interrupted` is raised at its end instead.

    It is entered for every message that is written, so it is no generator.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._pending: int | None = None

    def __enter__(self) -> None:
        self._depth += 1

    def __exit__(self, *_: object) -> None:
        self._depth -= 1
        if self._pending is not None and not self._depth:
            number, self._pending = self._pending, None
            raise Interrupted(number)

    def interrupt(self, signal_number: int) -> None:
        """Raise `Interrupted`, or leave it for the end of the context."""
        if not self._depth:
            raise Interrupted(signal_number)
        self._pending = signal_number


UNINTERRUPTED: Final = _Uninterrupted()
"""For the main thread's use: signals are handled nowhere else."""

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def raising_interrupts() -> Iterator[None]:
    """Turn the first SIGINT or SIGTERM into `Interrupted`; ignore further ones, so that the end is orderly.

    Outside the main thread, where Python handles no signals, this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(signal_number: int, frame: FrameType | None) -> None:
        for other in _SIGNALS:
            signal.signal(other, signal.SIG_IGN)
        UNINTERRUPTED.interrupt(signal_number)

    before = {number: signal.signal(number, interrupt) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
