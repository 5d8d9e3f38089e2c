from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import binom, chi2

from bus.packets import Packet
from bus.random_streams import random_stream
from channel.contract import Ledger, Placement, Slot
from channel.impairments.gilbert_elliott import (
    GilbertElliott,
    GilbertElliottChain,
    GilbertElliottLaw,
    law_of_bursts,
    states_bad,
)

FALSE_ALARM = 1e-6


def packet(sequence: int, source: str = "e1") -> Packet:
    return Packet(source, sequence, sequence, "exchange", np.array([1.0]))


def stage(streams: dict[str, str], **parameters: Any) -> GilbertElliott:
    generators = {name: random_stream(1, 0, name, "gilbert_elliott") for name in streams.values()}
    return GilbertElliott(Placement("gilbert_elliott", streams, generators), **parameters)


def fates(law: GilbertElliottLaw, ticks: int, seed: int) -> np.ndarray:
    chain = GilbertElliottChain(law, random_stream(seed, 0, "link", "gilbert_elliott"))
    return np.array([chain.at(tick) for tick in range(ticks)])


@pytest.mark.parametrize("tick", [0, 3, 20])
@pytest.mark.parametrize("loss_from", ["new_state", "old_state"])
def test_the_share_of_losses_at_a_tick_is_that_of_the_chain_over_independent_chains(
    tick: int, loss_from: Any
) -> None:
    """One look per independent chain, so that the count is binomial; false-alarm rate 1e-6 a case."""
    law = GilbertElliottLaw(0.1, 0.3, loss_good=0.02, loss_bad=0.9, initial="good", loss_from=loss_from)
    chains = 4000
    lost = sum(int(fates(law, tick + 1, seed)[tick]) for seed in range(chains))
    moves = tick + (1 if loss_from == "new_state" else 0)
    bad = law.stationary_bad * (1.0 - (1.0 - law.failure - law.recovery) ** moves)
    expected = bad * law.loss_bad + (1.0 - bad) * law.loss_good
    low, high = binom.interval(1 - FALSE_ALARM, chains, expected)
    assert low <= lost <= high


def test_a_stationary_chain_loses_its_stationary_share_from_the_first_tick() -> None:
    law = GilbertElliottLaw(0.2, 0.3, initial="stationary")
    chains = 4000
    lost = sum(int(fates(law, 1, seed)[0]) for seed in range(chains))
    low, high = binom.interval(1 - FALSE_ALARM, chains, law.stationary_loss)
    assert low <= lost <= high


def test_burst_lengths_follow_the_geometric_law() -> None:
    """The first burst of each of many independent chains; chi-square over lengths 1..7+, rate 1e-6."""
    law = law_of_bursts(mean_loss=0.2, mean_burst=2.5, initial="good", loss_from="new_state")
    lengths = []
    for seed in range(3000):
        lost = fates(law, 256, seed)
        begin = int(np.argmax(lost))
        if lost[begin]:
            after = np.flatnonzero(~lost[begin:])
            lengths.append(int(after[0]) if after.size else 256)
    counts = np.bincount(np.minimum(lengths, 7), minlength=8)[1:]
    law_of_lengths = np.array([law.recovery * (1 - law.recovery) ** (n - 1) for n in range(1, 7)])
    expected = len(lengths) * np.append(law_of_lengths, 1 - law_of_lengths.sum())
    assert ((counts - expected) ** 2 / expected).sum() < chi2.ppf(1 - FALSE_ALARM, df=6)


def test_mean_loss_and_mean_burst_are_those_of_the_chain() -> None:
    law = law_of_bursts(mean_loss=0.25, mean_burst=4.0, initial="good", loss_from="new_state")
    assert law.stationary_loss == pytest.approx(0.25)
    assert 1.0 / law.recovery == pytest.approx(4.0)


def test_the_netem_convention_shows_the_initial_state_first_and_is_otherwise_one_tick_late() -> None:
    rates = {"failure": 0.3, "recovery": 0.4, "initial": "bad"}
    new = fates(GilbertElliottLaw(**rates, loss_from="new_state"), 200, seed=5)
    old = fates(GilbertElliottLaw(**rates, loss_from="old_state"), 200, seed=5)
    assert old[0]
    assert np.array_equal(old[1:], new[:-1])


def test_links_of_a_shared_stream_meet_the_same_fates_in_whatever_order_they_are_asked() -> None:
    streams = {"e1->e2": "medium", "e2->e1": "medium"}
    shared = stage(streams, failure=0.3, recovery=0.3)
    ahead = [
        len(shared.lane("e1->e2").act(Slot(step, 0, step), [packet(step)], Ledger())) for step in range(300)
    ]
    behind = [
        len(shared.lane("e2->e1").act(Slot(step, 0, step), [packet(step)], Ledger())) for step in range(300)
    ]
    assert ahead == behind
    assert 0 < sum(ahead) < 300


def test_links_with_chains_of_their_own_differ() -> None:
    own = stage({"e1->e2": "e1->e2", "e2->e1": "e2->e1"}, failure=0.3, recovery=0.3)
    left, right = (
        [len(own.lane(link).act(Slot(step, 0, step), [packet(step)], Ledger())) for step in range(200)]
        for link in ("e1->e2", "e2->e1")
    )
    assert left != right


def test_a_chain_clocked_by_packets_rests_while_nothing_is_sent() -> None:
    busy = stage({"l": "l"}, failure=0.4, recovery=0.4, clock="packet").lane("l")
    lazy = stage({"l": "l"}, failure=0.4, recovery=0.4, clock="packet").lane("l")
    fates_busy = [len(busy.act(Slot(step, 0, step), [packet(step)], Ledger())) for step in range(100)]
    fates_lazy = []
    for step in range(200):
        passed = lazy.act(Slot(step, 0, step), [packet(step)] if step % 2 else [], Ledger())
        if step % 2:
            fates_lazy.append(len(passed))
    assert fates_busy == fates_lazy


def test_a_chain_clocked_by_slots_moves_with_every_slot_even_an_empty_one() -> None:
    dense = stage({"l": "l"}, failure=0.4, recovery=0.4, clock="slot").lane("l")
    sparse = stage({"l": "l"}, failure=0.4, recovery=0.4, clock="slot").lane("l")
    fates_dense = [len(dense.act(Slot(step, 0, step), [packet(step)], Ledger())) for step in range(200)]
    fates_sparse = [
        len(sparse.act(Slot(step, 0, step), [packet(step)] * (step % 2), Ledger())) for step in range(200)
    ]
    assert fates_dense[1::2] == fates_sparse[1::2]


def test_every_loss_stands_in_the_ledger() -> None:
    always = stage({"l": "l"}, failure=1.0, recovery=0.0)
    ledger = Ledger()
    assert not always.lane("l").act(Slot(0, 0, 0), [packet(4), packet(5)], ledger)
    assert [event.sequence for event in ledger.events] == [4, 5]
    assert [event.action for event in ledger.events] == ["lost", "lost"]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"failure": 0.1}, "give 'failure' and 'recovery', or"),
        ({"failure": 0.1, "recovery": 0.9, "mean_loss": 0.1}, "give 'failure' and 'recovery', or"),
        ({"mean_loss": 0.9, "mean_burst": 1.0}, "needs bursts of mean_burst 9 or more"),
        ({"mean_loss": 1.0, "mean_burst": 3.0}, "below 1"),
        ({"mean_loss": 0.1, "mean_burst": 2.0, "loss_bad": 0.5}, "loss_good 0 and loss_bad 1"),
    ],
)
def test_parameters_that_describe_no_chain_are_refused(parameters: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        stage({"l": "l"}, **parameters)


def test_a_shared_chain_cannot_be_clocked_by_one_links_packets() -> None:
    with pytest.raises(ValueError, match="clock: step"):
        stage({"a": "m", "b": "m"}, failure=0.1, recovery=0.9, clock="packet")


@pytest.mark.parametrize("rates", [(0.3, 0.4), (0.9, 0.8), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)])
def test_the_walk_of_a_whole_block_is_that_of_its_ticks_one_by_one(rates: tuple[float, float]) -> None:
    moves = random_stream(9, 0, "l", "moves").random(500)
    state, walked = True, []
    for move in moves:
        state = move >= rates[1] if state else move < rates[0]
        walked.append(state)
    assert states_bad(moves < rates[0], moves >= rates[1], True).tolist() == walked
