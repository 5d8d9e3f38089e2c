"""What estimators knew of signal attacks: probability, onset, end and value against the truth."""

from __future__ import annotations

import numpy as np

from orchestrator.score.accuracy import Errors, number
from orchestrator.score.attack_beliefs import AttackBeliefs
from orchestrator.score.gather import Bools, Floats, Ints
from orchestrator.score.results import AttackScore, SignalWindow

ALARM = 0.5
"""Probability above which an estimator says that there is an attack."""


def attack_scores(beliefs: AttackBeliefs, errors: Errors, from_step: int) -> list[AttackScore | None]:
    """Return the figures of each estimator; None for one that says nothing of attacks.

    A statement is judged against the truth of the step that it is about. Averages count those about steps
    from ``from_step`` on and published before any divergence; alarms count in full.
    """
    windows = _runs(beliefs.on)
    return [
        _attack_score(beliefs, i, windows, errors.alive[i], from_step)
        if not np.isnan(beliefs.probability[i]).all() or not np.isnan(beliefs.value[i]).all()
        else None
        for i in range(len(beliefs.about))
    ]


def _attack_score(
    beliefs: AttackBeliefs, i: int, windows: list[tuple[int, int]], alive: Bools, from_step: int
) -> AttackScore:
    about, probability = beliefs.about[i], beliefs.probability[i]
    judged = (about >= 0) & beliefs.known[about]
    on = judged & beliefs.on[about]
    off = judged & ~on
    counted = alive & (about >= from_step)
    told = ~np.isnan(probability)
    alarm = told & (probability > ALARM)
    off_from = beliefs.value[i] - beliefs.signal[about]
    return AttackScore(
        probability_on=_mean(probability[counted & on & told]),
        probability_off=_mean(probability[counted & off & told]),
        false_alarms=int(np.sum(off & alarm)) if told.any() else None,
        misses=int(np.sum(on & told & ~alarm)) if told.any() else None,
        rmse=_rmse(off_from, counted & on),
        windows=_windows(windows, np.where(judged & told, about, -1), alarm) if told.any() else [],
    )


def _runs(on: Bools) -> list[tuple[int, int]]:
    """Return the first and the last step of each run of steps under attack."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], on, [False]))))
    return [(int(first), int(end) - 1) for first, end in edges.reshape(-1, 2)]


def _windows(windows: list[tuple[int, int]], about: Ints, alarm: Bools) -> list[SignalWindow]:
    """Return when each attack was noticed, and when its end was."""
    starts = [first for first, _ in windows] + [len(about)]
    return [
        _window(
            (first, last), (about >= first) & (about <= last), (about > last) & (about < following), alarm
        )
        for (first, last), following in zip(windows, starts[1:], strict=True)
    ]


def _window(steps: tuple[int, int], inside: Bools, after: Bools, alarm: Bools) -> SignalWindow:
    """Return one attack's window, given which statements are about it and which about the steps after it."""
    first, last = steps
    return SignalWindow(
        first=first,
        last=last,
        statements=int(inside.sum()),
        statements_after=int(after.sum()),
        detection_delay=_delay(inside & alarm, first),
        release_delay=_delay(after & ~alarm, last + 1),
    )


def _delay(says_so: Bools, since: int) -> int | None:
    """Return the steps from ``since`` to the first publication that says so; None when none does."""
    return int(np.argmax(says_so)) - since if says_so.any() else None


def _mean(values: Floats) -> float | None:
    return number(float(values.mean())) if values.size else None


def _rmse(error: Floats, counted: Bools) -> float | None:
    """Return the root mean square of the Euclidean norms of the errors (K, q) that are counted and known."""
    if not error.shape[1]:
        return None
    squares = np.square(error).sum(axis=1)[counted]
    known = squares[~np.isnan(squares)]
    return number(float(np.sqrt(known.mean()))) if known.size else None
