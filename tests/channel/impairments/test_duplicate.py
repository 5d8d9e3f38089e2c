from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import binom, multivariate_normal, norm

from channel.impairments.duplicate import Duplicate


def test_a_duplicated_packet_arrives_twice_and_is_noted_once(driven: Any) -> None:
    arrived = driven(Duplicate, probability=1.0).run(3)
    assert arrived.sequences == [[0, 0], [1, 1], [2, 2]]
    assert [event.sequence for event in arrived.events_of("duplicated")] == [0, 1, 2]


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_the_share_and_the_pairs_of_duplicates_are_those_of_the_copula(
    driven: Any, correlation: float
) -> None:
    """One look at steps 300 and 301 of each of many independent streams: binomial, rate 1e-6 a count."""
    streams, probability = 1500, 0.3
    fates = []
    for seed in range(streams):
        lane = driven(Duplicate, seed=seed, probability=probability, correlation=correlation).lane()
        fates.append([lane._is_doubled(step) for step in (300, 301)])
    counts = np.array(fates)
    below = norm.ppf(probability)
    both = multivariate_normal.cdf([below, below], cov=[[1.0, correlation], [correlation, 1.0]])
    for count, expected in ((counts[:, 0].sum(), probability), (counts.all(axis=1).sum(), both)):
        low, high = binom.interval(1 - 1e-6, streams, expected)
        assert low <= count <= high


def test_it_knows_when_it_will_act_next(driven: Any) -> None:
    arrived = driven(Duplicate, probability=0.05).run(200)
    lane = driven(Duplicate, probability=0.05).lane()
    doubled = [step for step, slot in enumerate(arrived.slots) if len(slot) == 2]
    step, found = 0, []
    while (step := lane.quiet_until(step)) < 200:
        found.append(step)
        step += 1
    assert found == doubled
