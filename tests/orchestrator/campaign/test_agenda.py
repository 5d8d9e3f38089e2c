from __future__ import annotations

from dataclasses import dataclass

from orchestrator.campaign.agenda import Agenda
from orchestrator.campaign.block import Work
from orchestrator.campaign.grid import Variant


@dataclass
class Loaded:
    variant: Variant
    packed: bytes = b""


def agenda(
    trials: range, done: set[tuple[int, int]] | None = None, variants: int = 1, workers: int = 1
) -> Agenda:
    loaded = [Loaded(Variant(number, (), {})) for number in range(variants)]
    return Agenda(loaded, trials, done or set(), workers)  # type: ignore[arg-type]


def all_of(own: Agenda) -> list[Work]:
    works = []
    while (work := own.next()) is not None:
        works.append(work)
    return works


def test_every_trial_that_is_not_done_is_handed_out_once_in_consecutive_blocks() -> None:
    done = {(0, 2), (1, 0), (1, 9)}
    own = agenda(range(10), done, variants=2)
    own.note(1, 0.2)
    works = all_of(own)
    trials = [(work.variant, trial) for work in works for trial in work.trials]
    assert trials == [(v, t) for v in range(2) for t in range(10) if (v, t) not in done]
    assert all(list(work.trials) == list(range(work.trials[0], work.trials[-1] + 1)) for work in works)


def test_blocks_are_single_trials_until_their_time_is_known_and_then_small_enough_to_share() -> None:
    own = agenda(range(1000), workers=2)
    assert [len(work.trials) for work in (own.next(), own.next()) if work] == [1, 1]
    own.note(2, 0.02)  # a hundred a second
    sizes = [len(work.trials) for work in all_of(own)]
    assert max(sizes) == 125  # a fair share, though two seconds would hold two hundred
    assert sum(sizes) == 998


def test_trials_that_take_long_are_handed_out_one_by_one() -> None:
    own = agenda(range(8))
    own.note(1, 60.0)
    assert [len(work.trials) for work in all_of(own)] == [1] * 8


def test_a_block_that_died_comes_back_trial_by_trial_and_once() -> None:
    own = agenda(range(4))
    own.note(1, 0.1)
    work = Work(0, (0, 1, 2), {}, b"")
    assert own.died(work)
    again = [own.next() for _ in range(3)]
    assert [each.trials for each in again if each] == [(0,), (1,), (2,)]
    assert not own.died(Work(0, (1,), {}, b""))
