"""What the remedies against the lock-out of Ding 2021 do on its network, by direct calls.

The paper's own claims are tested on whole runs, in ``tests/papers``. The quick figures come from few trials
and have wide ranges; ``-m slow`` takes more. ``-s`` prints them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from nodes.estimators.secure_distributed import SecureDistributed

QUICK, FULL = 5, 100
WINDOWS = {4: (90, 95), 12: (50, 55)}
NEIGHBOURS = {"readmission": "neighbours"}
OWN_BOUND = [{"detector": "upper_bound"}, {"readmission": "own_bound"}]

pytestmark = pytest.mark.timeout(600)

trials = pytest.mark.parametrize("trials", [QUICK, pytest.param(FULL, marks=pytest.mark.slow)])


@dataclass(frozen=True)
class Campaign:
    """What many trials of one remedy under one attack gave; arrays (trials, attacked nodes)."""

    position_mse: np.ndarray
    """Over the steps from 10 on."""
    let_in: np.ndarray
    """Share of the attacked samples that were accepted."""
    locked_out: np.ndarray
    """Every sample of the last 20 steps was rejected."""

    def rmse(self) -> np.ndarray:
        return np.sqrt(self.position_mse.mean(axis=0))


@pytest.fixture(scope="module")
def campaign(network) -> Callable[..., Campaign]:
    """Return a call that attacks nodes 4 and 12 in so many trials; what it gave is kept for the module."""
    known: dict[tuple, Campaign] = {}

    def run(strength: float, trials: int, **remedy: str) -> Campaign:
        key = (strength, trials, *remedy.items())
        if key not in known:
            attacks = {f"s{node}": (strength, *window) for node, window in WINDOWS.items()}
            rows = [
                outcome(network.play(network.scenario(i), secure(remedy), attacks)) for i in range(trials)
            ]
            known[key] = Campaign(*(np.array(column) for column in zip(*rows, strict=True)))
        return known[key]

    return run


def secure(remedy):
    return lambda setting: SecureDistributed(setting, coupling=0.004, **remedy)


def outcome(play):
    mse = [(play.errors[10:, node - 1, 0] ** 2).mean() for node in WINDOWS]
    alarms = {node: play.alarms(node - 1) for node in WINDOWS}
    let_in = [1.0 - alarms[node][first : last + 1].mean() for node, (first, last) in WINDOWS.items()]
    return mse, let_in, [alarms[node][-20:].all() for node in WINDOWS]


@trials
def test_readmission_by_the_neighbours_ends_the_lock_out_and_lets_almost_nothing_in(campaign, trials):
    quiet, cured = campaign(0.0, trials), campaign(15.0, trials, **NEIGHBOURS)
    assert not cured.locked_out.any()
    assert cured.let_in.mean() < 0.05
    assert np.all(cured.rmse() < 1.5 * quiet.rmse())


@trials
@pytest.mark.parametrize("remedy", OWN_BOUND, ids=str)
def test_the_own_upper_bound_ends_the_lock_out_at_the_price_of_a_part_of_the_attack(campaign, trials, remedy):
    cured = campaign(15.0, trials, **remedy)
    assert not cured.locked_out.any()
    assert 0.05 < cured.let_in.mean() < 0.6


@pytest.mark.slow
@pytest.mark.parametrize("strength", [4.0, 8.0, 15.0, 30.0])
@pytest.mark.parametrize("remedy", [{}, *OWN_BOUND, NEIGHBOURS], ids=str)
def test_with_any_remedy_no_trial_is_locked_out_whatever_the_strength(campaign, strength, remedy):
    result = campaign(strength, 50, **remedy)
    locked_out = result.locked_out.any(axis=1).mean()
    print(
        f"\n{strength} {remedy}: let in {result.let_in.mean():.3f}, locked out {locked_out:.2f}, "
        f"rmse {result.rmse().round(2)}"
    )
    assert (locked_out > 0.0) == (remedy == {})
