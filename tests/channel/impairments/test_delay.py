from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom, kstest, norm, pareto, spearmanr, uniform

from bus.packets import Packet
from bus.random_streams import random_stream
from channel.contract import Ledger, Slot
from channel.impairments.delay import Delay, delays, skips

SPREAD = np.sqrt(3.0) / 2.0
LAWS = {
    "uniform": uniform(6.0, 8.0),
    "normal": norm(10.0, 4.0),
    "pareto": pareto(3.0, loc=10.0 - 4.0 * 1.5 / SPREAD, scale=4.0 / SPREAD),
}


def drawn(distribution: Any, correlation: float, streams: int) -> np.ndarray:
    """Return two successive delays in the second block of each of so many independent streams."""
    found = []
    for seed in range(streams):
        law = delays(10.0, 4.0, distribution, correlation)
        generator = random_stream(seed, 0, "l", "delay")
        law(generator, 256)
        found.append(law(generator, 2))
    return np.array(found)


@pytest.mark.parametrize("correlation", [0.0, 0.7])
@pytest.mark.parametrize("distribution", LAWS)
def test_each_delay_follows_its_law_whatever_the_correlation(distribution: Any, correlation: float) -> None:
    """Kolmogorov-Smirnov over independent streams, above the cut at 0; false-alarm rate 1e-6 a case."""
    found = drawn(distribution, correlation, 800)[:, 0]
    law = LAWS[distribution]
    above = found[found > 0.0]
    assert kstest(above, lambda x: (law.cdf(x) - law.cdf(0.0)) / law.sf(0.0)).pvalue > 1e-6
    low, high = binom.interval(1 - 1e-6, len(found), law.cdf(0.0))
    assert low <= (found == 0.0).sum() <= high


@pytest.mark.parametrize("correlation", [0.0, 0.7])
@pytest.mark.parametrize("distribution", LAWS)
def test_successive_delays_have_the_rank_correlation_of_the_copula(
    distribution: Any, correlation: float
) -> None:
    """Over independent streams; Fisher's transform with its variance bounded, false-alarm rate 1e-6."""
    streams = 800
    found = drawn(distribution, correlation, streams)
    expected = 6.0 / np.pi * np.arcsin(correlation / 2.0)
    distance = np.arctanh(spearmanr(found[:, 0], found[:, 1]).statistic) - np.arctanh(expected)
    assert abs(distance) < norm.isf(5e-7) * np.sqrt(1.2 / (streams - 3))


def test_a_packet_reaches_the_slot_of_its_step_plus_its_delay_rounded_down(driven: Any) -> None:
    arrived = driven(Delay, delay=2.9).run(5)
    assert arrived.sequences == [[], [], [0], [1], [2]]
    assert [event.magnitude for event in arrived.events_of("delayed")] == [2.0] * 5
    undelayed = driven(Delay, delay=0.99).run(3)
    assert undelayed.sequences == [[0], [1], [2]]
    assert not undelayed.events


def test_a_delayed_packet_arrives_in_the_round_in_which_it_was_sent(driven: Any) -> None:
    lane = driven(Delay, delay=1.0).lane()
    sent = {
        (step, round_): [Packet("e1", step, 2 * step + round_, "exchange", np.zeros(1))]
        for step in (0, 1, 2)
        for round_ in (0, 1)
    }
    for (step, round_), packets in sent.items():
        arrived = lane.act(Slot(step, round_, 2 * step + round_), packets, Ledger())
        assert list(arrived) == (sent[step - 1, round_] if step else [])


def test_every_packet_arrives_once_and_jitter_lets_some_overtake(driven: Any) -> None:
    arrived = driven(Delay, delay=3.0, jitter=2.0, distribution="normal").run(
        400, act=lambda step: step < 300
    )
    order = list(itertools.chain(*arrived.sequences))
    assert sorted(order) == list(range(400))
    assert order != sorted(order)


def test_what_was_delayed_is_what_the_log_says(driven: Any) -> None:
    arrived = driven(Delay, delay=2.0, jitter=2.0).run(200)
    noted = {event.sequence: event.magnitude for event in arrived.events_of("delayed")}
    for step, slot in enumerate(arrived.sequences):
        for sequence in slot:
            assert noted.get(sequence, 0.0) == step - sequence


@pytest.mark.parametrize("gap", [1, 5])
def test_packets_skip_the_delay_no_more_often_than_their_gap_allows(gap: int) -> None:
    """With probability 1 exactly every gap-th step; with less, never closer."""
    always = skips(1.0, gap)(random_stream(1, 0, "l", "d"), 50)
    assert np.flatnonzero(always).tolist() == list(range(gap - 1, 50, gap))
    law = skips(0.5, gap)
    some = np.concatenate([law(random_stream(seed, 0, "l", "d"), 256) for seed in range(4)])
    assert np.diff(np.flatnonzero(some)).min() >= gap


def test_those_that_skip_overtake_and_leave_the_other_delays_as_they_were(driven: Any) -> None:
    given = {"delay": 5.0, "jitter": 3.0}
    plain = {e.sequence: e.magnitude for e in driven(Delay, **given).run(300).events}
    some = {e.sequence: e.magnitude for e in driven(Delay, **given, reorder=0.3).run(300).events}
    assert set(some) < set(plain)
    assert all(plain[sequence] == delay for sequence, delay in some.items())
    low, high = binom.interval(1 - 1e-6, len(plain), 0.3)
    assert low <= len(plain) - len(some) <= high


@pytest.mark.parametrize(
    ("given", "cure"),
    [
        ({"distribution": "constant", "jitter": 1.0}, "leave out 'jitter'"),
        ({"gap": 3}, "give 'reorder'"),
    ],
)
def test_parameters_that_make_no_sense_together_are_refused(driven: Any, given: Any, cure: str) -> None:
    with pytest.raises(ValueError, match=cure):
        driven(Delay, delay=1.0, **given)
