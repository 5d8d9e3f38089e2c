"""The exit codes that scripts may rely on."""

from __future__ import annotations

from typing import Final

PASSED: Final = 0
EXPECTATION_FAILED: Final = 1
BAD_INPUT: Final = 2
RUN_FAILED: Final = 3
"""A node failed or stalled, or the log could not be written.

An interrupted run ends with 128 + the signal: 130, 143.
"""
