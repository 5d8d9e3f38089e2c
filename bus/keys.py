"""Every key of the bus, spelled in one place.

A *topic* is a key without its run's prefix: ``tx/s4/measurement``. The log holds topics; the bus carries
``gauntlet/{run}/{topic}``, so that runs side by side cannot hear each other.
"""

from __future__ import annotations

MEASUREMENT = "measurement"
"""The stream of a sensor's measurements."""
CORRECT = "correct"
"""The phase in which estimators take the measurements."""
EXCHANGE = "exchange"
"""The stream of what estimators send to their neighbours, and the phase in which they take it."""

CONTROL = "control"
"""The stream of a controller's inputs, and the phase in which plant and estimators take them."""
WATCH = "watch"
"""The stream on which a node tells the channel what an adversary's trigger was granted to see."""

START = "control/start"
STOP = "control/stop"


def prefix(run: str) -> str:
    """Return the key prefix of a run, with its trailing slash."""
    return f"gauntlet/{run}/"


def truth(plant: str) -> str:
    """Return the topic of the plant's true state; only sensors and the recorder may read it."""
    return f"truth/{plant}"


def tx(node: str, stream: str) -> str:
    """Return the topic on which a node sends its slot of a stream (`MEASUREMENT` or `EXCHANGE`)."""
    return f"tx/{node}/{stream}"


def rx(node: str, phase: str) -> str:
    """Return the topic of a node's inbox: what reaches it in a phase (`CORRECT` or `EXCHANGE`)."""
    return f"rx/{node}/{phase}"


def credit(node: str) -> str:
    """Return the topic on which the recorder grants steps to a node that no other message paces."""
    return rx(node, "credit")


def estimate(node: str) -> str:
    """Return the topic of an estimator's published belief."""
    return f"estimate/{node}"


def phase_of(stream: str) -> str:
    """Return the phase in which a stream's packets are taken."""
    return CORRECT if stream == MEASUREMENT else stream


def channel(phase: str) -> str:
    """Return the topic on which the channel tells what it did to every link in a phase."""
    return f"channel/{phase}"


def finished(node: str) -> str:
    """Return the topic of a process's last words: its wall-clock figures, which never enter the log."""
    return f"control/finished/{node}"


def departed(node: str) -> str:
    """Return the topic of the orchestrator's note to itself that a process is gone and said all it will."""
    return f"control/departed/{node}"


def alive(node: str) -> str:
    """Return the liveliness key of a process."""
    return f"alive/{node}"
