"""What an estimator knows of the plant's input: what the controllers told it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Plant


class CommandedInput:
    """The part ``B u`` (n,) of a prediction; None until the first command is due, and then never again.

    A command that did not arrive counts as the plant counts it: as zero, or as the one before.
    """

    def __init__(self, plant: Plant) -> None:
        n = len(plant.initial_mean)
        self._B = np.ascontiguousarray(getattr(plant, "B", np.zeros((n, 0))))
        self._holds = bool(getattr(plant, "holds_input", False))
        self._none: Vector = np.zeros(n)
        self.effect: Vector | None = None

    def add_to(self, predicted: Vector) -> Vector:
        """Return states (n,) or (N, n) that were predicted without any input, with its effect."""
        return predicted if self.effect is None else predicted + self.effect

    def take(self, packets: Sequence[Packet]) -> None:
        """Take the commands of one step, of which the newest counts; raises ValueError on another size."""
        if packets:
            command = max(packets, key=lambda packet: packet.sequence).values
            if command.shape != (self._B.shape[1],):
                raise ValueError(f"an input has the shape {command.shape}, not {(self._B.shape[1],)}")
            self.effect = self._B.dot(command)
        elif self.effect is None or not self._holds:
            self.effect = self._none


class Commanded:
    """An estimator that is told what the controllers command, and predicts with it."""

    _input: CommandedInput

    def control(self, step: int, packets: Sequence[Packet]) -> None:
        """Take the input that was commanded in ``step``, for the prediction that follows."""
        self._input.take(packets)
