"""The base of all errors that are the user's to mend."""

from __future__ import annotations


class InputError(ValueError):
    """What was given cannot be used; the text names place and cure. The command ends with exit code 2."""
