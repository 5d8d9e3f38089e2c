"""What is left to do, cut into blocks: small enough to lose one, large enough to be worth sending."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import replace

from orchestrator.campaign.block import Work
from orchestrator.campaign.results import Trial
from orchestrator.campaign.variants import LoadedVariant

_BLOCK_S = 2.0
"""How long a block shall take."""
_LARGEST = 500
_SHARES = 4
"""Blocks that each worker gets at least, of a variant, while there are trials enough."""


class Agenda:
    """Hands out the trials that are not done, variant by variant, in blocks of consecutive ones.

    A block whose worker died comes back trial by trial, once; one of a single trial that dies again is given
    up.

    Parameters
    ----------
    variants
        All variants.
    trials
        The numbers of all trials.
    done
        What need not be run.
    workers
        How many work side by side.
    """

    def __init__(
        self, variants: Sequence[LoadedVariant], trials: range, done: Collection[Trial], workers: int
    ) -> None:
        self._variants = variants
        self._workers = workers
        self._left: deque[tuple[int, range]] = deque()
        for number in range(len(variants)):
            self._left += [(number, run) for run in _runs(number, trials, done)]
        self._again: deque[Work] = deque()
        self._tried: set[Trial] = set()
        self._spent_s = 0.0
        self._finished = 0
        self.waiting = sum(len(run) for _, run in self._left)

    def next(self) -> Work | None:
        """Return the next block, None when there is none."""
        if self._again:
            work = self._again.popleft()
        elif self._left:
            number, run = self._left.popleft()
            size = min(self._size(), len(run))
            if size < len(run):
                self._left.appendleft((number, run[size:]))
            own = self._variants[number]
            work = Work(number, tuple(run[:size]), own.variant.settings, own.packed)
        else:
            return None
        self.waiting -= len(work.trials)
        return work

    def note(self, trials: int, taken_s: float) -> None:
        """Note how long one worker took for some trials: the next blocks are sized by it."""
        self._finished += trials
        self._spent_s += taken_s

    def died(self, work: Work) -> bool:
        """Take back a block whose worker died; return whether its trials will be tried once more."""
        again = [trial for trial in work.trials if (work.variant, trial) not in self._tried]
        if not again:
            return False
        self._tried.update((work.variant, trial) for trial in again)
        self._again += [replace(work, trials=(trial,)) for trial in again]
        self.waiting += len(again)
        return True

    def _size(self) -> int:
        """Return how many trials the next block shall have: one until it is known how long they take."""
        if not self._finished:
            return 1
        by_time = int(_BLOCK_S * self._finished / max(self._spent_s, 1e-9))
        fair = -(-self.waiting // (_SHARES * self._workers))
        return max(1, min(by_time, fair, _LARGEST))


def _runs(number: int, trials: range, done: Collection[Trial]) -> list[range]:
    """Return the runs of consecutive trials of a variant that are not done."""
    runs: list[range] = []
    for trial in trials:
        if (number, trial) in done:
            continue
        if runs and runs[-1].stop == trial:
            runs[-1] = range(runs[-1].start, trial + 1)
        else:
            runs.append(range(trial, trial + 1))
    return runs
