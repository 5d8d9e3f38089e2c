"""What goes wrong with a log, told with its cure."""

from __future__ import annotations

from orchestrator.errors import InputError


class LogError(InputError):
    """A log cannot be written, read or understood; the text names the file, what is wrong, and the cure."""
