"""An estimator in a process of the user's own, in any language that speaks Zenoh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NoReturn

from annotated_types import Ge, MinLen

from bus.packets import Packet
from nodes.contract import Setting


class External:
    """Runs a command as the node's process; what it must say and may hear is the wire protocol's.

    The command finds in its environment ``GAUNTLET_ENDPOINT``, ``GAUNTLET_RUN``, ``GAUNTLET_NODE``,
    ``GAUNTLET_PASSWORD``, ``GAUNTLET_STEPS`` and ``GAUNTLET_PERIOD_S``.

    Parameters
    ----------
    command
        The program and its arguments; it is looked up on the PATH.
    rounds
        Exchange rounds in each step.
    """

    def __init__(
        self, setting: Setting, *, command: Annotated[list[str], MinLen(1)], rounds: Annotated[int, Ge(0)] = 0
    ) -> None:
        self.rounds = rounds
        self._name = setting.name

    def _refuse(self) -> NoReturn:
        raise RuntimeError(f"{self._name} is an external node: run it with the backend 'processes'")

    def correct(self, step: int, packets: Sequence[Packet]) -> NoReturn:
        """Refuse: an external estimator cannot run inside another process."""
        self._refuse()

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> NoReturn:
        """Refuse: an external estimator cannot run inside another process."""
        self._refuse()

    def estimate(self, step: int) -> NoReturn:
        """Refuse: an external estimator cannot run inside another process."""
        self._refuse()
