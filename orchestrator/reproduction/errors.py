"""The one error of lists of campaigns and figures."""

from __future__ import annotations

from orchestrator.errors import InputError


class ReproduceError(InputError):
    """A list of campaigns and figures cannot be used; the text names the place and the cure."""
