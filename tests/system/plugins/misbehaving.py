"""Estimators that fail in the ways in which users' estimators fail."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Literal

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Belief, Detection, Setting

Fault = Literal["none", "raise", "hang", "diverge", "exit", "swap"]


class Misbehaving:
    """Publishes a constant; from step ``at`` on it shows its ``fault``. Each step waits ``pause_s``."""

    rounds = 0

    def __init__(self, setting: Setting, *, fault: Fault = "none", at: int = 0, pause_s: float = 0.0) -> None:
        self._size = setting.plant.initial_mean.size
        self._source = next(iter(setting.sensors))
        self._fault = fault
        self._at = at
        self._pause_s = pause_s
        self._state = np.zeros(self._size)

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        time.sleep(self._pause_s)
        if step >= self._at:
            if self._fault == "raise":
                raise ZeroDivisionError("the gain has vanished")
            if self._fault == "hang":
                time.sleep(3600.0)
            if self._fault == "diverge":
                self._state = np.full(self._size, np.nan)
            if self._fault == "exit":
                raise SystemExit(0)
        return None

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        raise AssertionError("it has no exchange rounds")

    def estimate(self, step: int) -> Belief:
        detections = []
        if self._fault == "swap" and step >= self._at:
            detections = [Detection(step, self._source, 0.5, False)]  # type: ignore[arg-type]
        return Belief(state=self._state, covariance=np.eye(self._size), detections=detections)
