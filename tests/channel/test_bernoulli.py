from __future__ import annotations

import numpy as np
from scipy.stats import binom

from bus.packets import Packet
from bus.random_streams import random_stream
from channel.contract import Ledger, Placement, Slot
from channel.impairments.bernoulli import Bernoulli


def test_losses_are_independent_with_the_given_probability() -> None:
    """Losses and pairs of successive losses are binomial; false-alarm rate 2e-6."""
    steps = 20_000
    stage = Bernoulli(
        Placement("bernoulli", {"l": "l"}, {"l": random_stream(2, 0, "l", "bernoulli")}), loss=0.3
    )
    packets = [Packet("s1", 0, 0, "measurement", np.zeros(1))]
    lost = np.array(
        [not stage.lane("l").act(Slot(step, 0, step), packets, Ledger()) for step in range(steps)]
    )
    low, high = binom.interval(1 - 1e-6, steps, 0.3)
    assert low <= lost.sum() <= high
    low, high = binom.interval(1 - 1e-6, steps // 2, 0.09)
    assert low <= (lost[::2] & lost[1::2]).sum() <= high
