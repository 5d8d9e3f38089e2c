"""What can be wrong with a report that is asked for."""

from __future__ import annotations

from orchestrator.errors import InputError


class ReportError(InputError):
    """The report cannot be made; the text tells the cure."""
