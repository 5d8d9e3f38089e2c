from __future__ import annotations

import numpy as np
from scipy.stats import binom, multivariate_normal, norm

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


def test_correlated_losses_come_in_pairs_as_often_as_the_copula_says() -> None:
    """Two steps of each of many independent streams, so that counts are binomial; rate 1e-6 each."""
    streams, loss, correlation = 1500, 0.2, 0.9
    fates = []
    for seed in range(streams):
        placement = Placement("bernoulli", {"l": "l"}, {"l": random_stream(seed, 0, "l", "bernoulli")})
        lane = Bernoulli(placement, loss=loss, correlation=correlation).lane("l")
        packets = [Packet("s1", 0, 0, "measurement", np.zeros(1))]
        fates.append([not lane.act(Slot(step, 0, step), packets, Ledger()) for step in (255, 256)])
    lost = np.array(fates)
    below = norm.ppf(loss)
    both = multivariate_normal.cdf([below, below], cov=[[1.0, correlation], [correlation, 1.0]])
    for count, expected in ((lost[:, 1].sum(), loss), (lost.all(axis=1).sum(), both)):
        low, high = binom.interval(1 - 1e-6, streams, expected)
        assert low <= count <= high
