"""What the tests of attacks that know a model share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from bus.packets import Packet
from bus.random_streams import random_stream
from channel.contract import Lane, Ledger, Placement, Slot
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.sensors.linear import Linear as LinearSensor
from orchestrator.topology.knowledge import knowledge


def known(
    A: Sequence[Sequence[float]],
    B: Sequence[Sequence[float]] | None,
    sensors: dict[str, Sequence[Sequence[float]]],
    heard: Sequence[str],
) -> dict[str, Any]:
    """Return what an adversary knows who was granted all of a plant, its sensors and the estimator e1."""
    plant = LinearPlant(
        1.0,
        A=[list(row) for row in A],
        B=None if B is None else [list(row) for row in B],
        process_noise=Gaussian(std=0.1),
        initial=Gaussian(std=1.0),
    )
    models = {
        name: LinearSensor(plant, C=[list(row) for row in C], noise=Gaussian(std=0.2))
        for name, C in sensors.items()
    }
    return knowledge(plant, models, {"e1": heard}, frozenset({"model", "innovations"}))


def placement(granted: dict[str, Any], *links: str, first: int = 0, last: int = 99) -> Placement:
    streams = {link: link for link in links}
    generators = {link: random_stream(1, 0, link, "attack") for link in links}
    return Placement("attack", streams, generators, first, last, knowledge=granted)


def added_by(
    lane: Lane, values: Sequence[float], active: Callable[[int], bool], steps: int
) -> tuple[np.ndarray, Ledger]:
    """Return what a lane adds (steps, m) to packets of these values, and what it noted."""
    ledger, added = Ledger(), []
    source = lane.link.partition("->")[0]
    for step in range(steps):
        packet = Packet(source, step, step, "measurement", np.array(values, dtype=np.float64))
        pass_on = lane.act if active(step) else lane.rest
        (passed,) = pass_on(Slot(step, 0, step), [packet], ledger)
        assert (passed.source, passed.sent_step, passed.sequence) == (source, step, step)
        added.append(passed.values - packet.values)
    return np.array(added), ledger
