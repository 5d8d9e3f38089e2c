from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from bus.random_streams import random_stream, sequential_streams


def test_the_same_address_gives_the_same_draws() -> None:
    first = random_stream(3, 1, "s4", "measurement_noise").standard_normal(50)
    second = random_stream(3, 1, "s4", "measurement_noise").standard_normal(50)
    assert np.array_equal(first, second)


@pytest.mark.parametrize(
    "other", [(4, 1, "s4", "noise"), (3, 2, "s4", "noise"), (3, 1, "s5", "noise"), (3, 1, "s4", "other")]
)
def test_every_part_of_the_address_matters(other: tuple[int, int, str, str]) -> None:
    own = random_stream(3, 1, "s4", "noise").random(4)
    assert not np.array_equal(own, random_stream(*other).random(4))


def test_name_and_purpose_do_not_run_into_each_other() -> None:
    assert random_stream(0, 0, "ab", "c").random() != random_stream(0, 0, "a", "bc").random()


def test_another_process_with_another_hash_seed_draws_the_same() -> None:
    program = (
        "from bus.random_streams import random_stream; "
        "print(repr(random_stream(7, 0, 'e1->e2', 'x').random()))"
    )
    drawn = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": "."},
            capture_output=True,
            text=True,
            check=True,
            timeout=60,
        ).stdout
        for seed in ("1", "2")
    }
    assert drawn == {repr(random_stream(7, 0, "e1->e2", "x").random()) + "\n"}


def test_sequential_streams_are_those_of_their_address_alone() -> None:
    first = [own.random() for own in sequential_streams(random_stream(1, 2, "e1", "estimator"), 3)]
    again = [own.random() for own in sequential_streams(random_stream(1, 2, "e1", "estimator"), 3)]
    other = [own.random() for own in sequential_streams(random_stream(1, 2, "e2", "estimator"), 3)]
    assert first == again
    assert len({*first, *other}) == 6


def test_sequential_streams_draw_nothing_of_the_stream_itself() -> None:
    plain, spawning = (random_stream(1, 2, "e1", "estimator") for _ in range(2))
    sequential_streams(spawning, 3)
    assert plain.random() == spawning.random()
