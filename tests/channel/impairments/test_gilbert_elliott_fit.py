"""Fits give back the chain that made the losses."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import chi2

from bus.random_streams import random_stream
from channel.impairments.gilbert_elliott import GilbertElliottChain, GilbertElliottLaw
from channel.impairments.gilbert_elliott_fit import _expect, fit_gilbert, fit_gilbert_elliott

FALSE_ALARM = 1e-6


def recorded(law: GilbertElliottLaw, ticks: int, seed: int) -> np.ndarray:
    chain = GilbertElliottChain(law, random_stream(seed, 0, "l", "fit"))
    return np.array([chain.at(tick) for tick in range(ticks)])


def test_the_simple_chain_is_fitted_by_counting_its_moves() -> None:
    fit = fit_gilbert(np.array([0, 0, 1, 1, 1, 0, 0, 0, 1, 0], dtype=bool))
    assert fit.failure == pytest.approx(2 / 5)
    assert fit.recovery == pytest.approx(2 / 4)
    assert fit.failure_error == pytest.approx(np.sqrt(0.4 * 0.6 / 5))


def test_fitted_rates_scatter_around_the_true_ones_as_their_errors_say() -> None:
    """Sum of squared standardised errors of 200 independent traces of 4000 slots; false-alarm rate 1e-6."""
    law = GilbertElliottLaw(0.05, 0.4, initial="stationary")
    fits = [fit_gilbert(recorded(law, 4000, seed)) for seed in range(200)]
    for errors in (
        [(fit.failure - 0.05) / fit.failure_error for fit in fits],
        [(fit.recovery - 0.4) / fit.recovery_error for fit in fits],
    ):
        low, high = chi2.interval(1 - FALSE_ALARM, len(fits))
        assert low <= np.square(errors).sum() <= high


def test_a_trace_without_losses_says_nothing_about_recovery() -> None:
    fit = fit_gilbert(np.zeros(50, dtype=bool))
    assert (fit.failure, fit.recovery) == (0.0, 0.0)
    assert np.isinf(fit.recovery_error)


def test_the_likelihood_is_that_of_the_sum_over_all_paths_of_the_chain() -> None:
    losses = np.array([0, 1, 1, 0, 1], dtype=bool)
    failure, recovery, loss = 0.2, 0.3, (0.1, 0.7)
    move = {(0, 0): 1 - failure, (0, 1): failure, (1, 0): recovery, (1, 1): 1 - recovery}
    start = (recovery / (failure + recovery), failure / (failure + recovery))
    total, occupied, moves = 0.0, np.zeros((5, 2)), np.zeros(2)
    for path in itertools.product((0, 1), repeat=5):
        p = start[path[0]] * np.prod([move[pair] for pair in itertools.pairwise(path)])
        p *= np.prod([loss[s] if lost else 1 - loss[s] for s, lost in zip(path, losses, strict=True)])
        total += p
        occupied[np.arange(5), path] += p
        moves += [p * list(itertools.pairwise(path)).count(pair) for pair in ((0, 1), (1, 0))]
    emission = np.where(losses[:, None], loss, 1.0 - np.array(loss))
    found, (failures, recoveries), likelihood = _expect(emission, failure, recovery)
    np.testing.assert_allclose(found, occupied / total)
    np.testing.assert_allclose([failures, recoveries], moves / total)
    assert likelihood == pytest.approx(np.log(total))


def test_the_full_chain_is_found_again_and_fits_better_than_the_simple_one() -> None:
    """Wilks: twice the gain in log-likelihood over the true chain is chi-square of 4; false-alarm rate 1e-6.

    The fit may fall short of the maximum by its tolerance, and the true chain cannot beat it by more.
    """
    law = GilbertElliottLaw(0.03, 0.2, loss_good=0.02, loss_bad=0.7, initial="stationary")
    losses = recorded(law, 6000, seed=11)
    fit = fit_gilbert_elliott(losses)
    emission = np.where(losses[:, None], [0.02, 0.7], [0.98, 0.3])
    true = _expect(emission, 0.03, 0.2)[2]
    assert fit.converged
    assert -0.1 < 2.0 * (fit.log_likelihood - true) < chi2.isf(FALSE_ALARM, 4)
    assert fit.log_likelihood > fit_gilbert(losses).log_likelihood + 10.0
    assert fit.loss_good < 0.1 < fit.loss_bad


@pytest.mark.parametrize("losses", [np.zeros(9, dtype=bool), np.ones(9, dtype=bool)])
def test_losses_that_tell_no_states_apart_are_refused(losses: np.ndarray) -> None:
    with pytest.raises(ValueError, match="the same fate"):
        fit_gilbert_elliott(losses)
    with pytest.raises(ValueError, match="two slots"):
        fit_gilbert(losses[:1])
