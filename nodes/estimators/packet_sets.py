"""Sets of packets of which at most one is genuine, and what is believed of the fakes among them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Matrix


@dataclass(frozen=True)
class FakeBox:
    """Fakes are believed uniform between ``low`` and ``high``: one number, or one for each output.

    Where an adversary really puts them is for him to choose, so the density ``kappa`` counts outside the box
    as well, and no packet is impossible. A ``hard`` box is believed in: what lies outside is genuine.
    """

    low: float | list[float]
    high: float | list[float]
    hard: bool = False

    def law(self, outputs: int) -> FakeLaw:
        """Return the law of fakes of ``outputs`` components; raises ValueError for no box."""
        low, high = np.asarray(self.low, dtype=np.float64), np.asarray(self.high, dtype=np.float64)
        for bound in (low, high):
            if bound.ndim and bound.size != outputs:
                raise ValueError(
                    f"the box of 'fakes' has {bound.size} components, a sensor {outputs}; give one number, "
                    "or one for each output"
                )
        widths = np.broadcast_to(high - low, (outputs,))
        if not np.all((widths > 0.0) & np.isfinite(widths)):
            raise ValueError("the box of 'fakes' is empty; give 'low' below 'high'")
        return FakeLaw(low, high, -float(np.log(widths).sum()), self.hard)


@dataclass(frozen=True)
class FakeLaw:
    """The density of the fakes of one sensor: ``log_level`` in the box, and outside unless it is ``hard``."""

    low: Vector
    high: Vector
    log_level: float
    hard: bool

    def log_densities(self, values: Matrix) -> Vector:
        """Return ``log kappa`` (Z,) of packets (Z, m)."""
        levels = np.full(len(values), self.log_level)
        if self.hard:
            levels[~((values >= self.low) & (values <= self.high)).all(axis=1)] = -np.inf
        return levels


def packet_sets(step: int, packets: Sequence[Packet], sizes: Mapping[str, int]) -> dict[str, list[Packet]]:
    """Return the packets that measure the state of ``step``, by sensor in the sensors' order.

    It leaves out packets of earlier steps, of another size than the sensor's (``sizes``), and copies: equal
    values count once, for a set holds nothing twice.
    """
    found: dict[str, dict[bytes, Packet]] = {}
    for packet in packets:
        if packet.sent_step == step and packet.values.size == sizes.get(packet.source):
            found.setdefault(packet.source, {}).setdefault(packet.values.tobytes(), packet)
    return {source: list(found[source].values()) for source in sizes if source in found}


class Pooled(NamedTuple):
    """Measurements that stand for one: the mean ``values`` (m,) with its noise covariance ``noise`` (m, m).

    ``scatter`` is what the NIS of all has beyond that of the mean: chi-square with ``scatter_dof`` degrees of
    freedom when they measure the same, whatever the state and the signal are.
    """

    values: Vector
    noise: Matrix
    scatter: float
    scatter_dof: int


def pooled(packets: Sequence[Packet], noise: Matrix) -> Pooled:
    """Return the sufficient statistic of packets (Z, m) that a filter takes all for measurements.

    Of independent ``y_i = h + v_i``, ``v_i ~ N(0, R)``, the mean with ``R / Z`` says all of ``h``; what is
    left of the likelihood, ``exp(-scatter / 2)``, depends on no hypothesis about it.
    """
    if len(packets) == 1:
        return Pooled(packets[0].values, noise, 0.0, 0)
    values = np.array([packet.values for packet in packets])
    mean: Vector = values.mean(axis=0)
    apart = values - mean
    scatter = float(np.sum(apart * np.linalg.solve(noise, apart.T).T))
    return Pooled(mean, noise / len(packets), scatter, apart.size - mean.size)
