from __future__ import annotations

import pytest

from channel.attacks.drift import Drift


def test_the_error_grows_by_the_rate_from_the_first_step_of_the_window(placed, played):
    attack = played(Drift(placed(first=5), rate=[0.5, -1.0]), first=5)
    assert attack.says(4, 1.0, 1.0) == [1.0, 1.0]
    assert [attack.says(step, 1.0, 1.0) for step in (5, 6, 9)] == [[1.5, 0.0], [2.0, -1.0], [3.5, -4.0]]
    assert attack.actions == [(5, "attacked"), (6, "attacked"), (9, "attacked")]


def test_a_rate_that_does_not_fit_is_refused(placed, played):
    with pytest.raises(ValueError, match="give one 'rate'"):
        played(Drift(placed(), rate=[1.0, 2.0])).says(0, 1.0, 2.0, 3.0)
    with pytest.raises(ValueError, match="2 entries for 1 components"):
        Drift(placed(), rate=[1.0, 2.0], components=[0])
