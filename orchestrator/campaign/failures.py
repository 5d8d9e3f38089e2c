"""Trials that were lost with their worker: what is said of them, unlike of failures of the code.

A node that raises in a trial does so again. What a machine did to a trial (no memory, no time) it need not do
again: a campaign that goes on tries lost trials anew, so that its results are those of one that lost none.
"""

from __future__ import annotations

import signal

_TOO_LONG = "it took longer than "
_WORKER = "its worker "


def too_long(patience_s: float) -> str:
    """Return what is said of a trial that was given up after so many seconds, twice."""
    return f"{_TOO_LONG}{patience_s:g} s, twice; see --trial-timeout"


def ended(exit_code: int) -> str:
    """Return what is said of a trial whose worker ended twice, at last with a code; -n is signal n."""
    if exit_code < 0:
        cause = " (out of memory?)" if -exit_code == signal.SIGKILL else ""
        return f"{_WORKER}was ended twice by {signal.Signals(-exit_code).name}{cause}"
    return f"{_WORKER}ended twice, at last with exit code {exit_code}; see its log in 'workers'"


def ended_on_cluster() -> str:
    """Return what is said of a trial that a Dask cluster gave up, as several of its workers ended with it."""
    return f"{_WORKER}of the Dask cluster ended, time and again"


def is_lost(message: str | None) -> bool:
    """Return whether the message of a row is that of a lost trial; a node's begins with its name."""
    return message is not None and message.startswith((_TOO_LONG, _WORKER))
