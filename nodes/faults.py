"""Scheduled ends of nodes: what a topology may state, and nothing else; the processes carry them out."""

from __future__ import annotations


class Crash:
    """The node's process dies at the first step of the attack, and the node is silent from there on.

    The channel makes empty slots for it, so its neighbours go on; nothing that it owed is recorded.
    """

    silence = "crash"


class Hang:
    """The node's process stays and does nothing any more from the first step of the attack on.

    To everybody else it is silent, as after a crash; its process is ended with the run.
    """

    silence = "hang"
