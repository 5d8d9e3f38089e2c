"""What all stages share: false packets."""

from __future__ import annotations

import numpy as np
import pytest

from bus.packets import Packet
from channel.contract import Placement, distance, norm


def test_a_false_packet_never_holds_what_no_message_carries() -> None:
    placement = Placement("bias@s1->e1", {}, {})
    genuine = Packet("s1", 0, 0, "measurement", np.zeros(2))
    for values in ([np.inf, 0.0], [np.nan, 0.0], [np.inf, -np.inf]):
        with pytest.raises(FloatingPointError, match="bias@s1->e1 made a value that is not finite"):
            placement.forged(genuine, np.array(values))
    greatest = np.full(2, np.finfo(np.float64).max)
    assert placement.forged(genuine, greatest).values is greatest


def test_magnitudes_are_finite_whatever_the_values() -> None:
    greatest = np.full(2, np.finfo(np.float64).max)
    assert norm(greatest) == distance(greatest, -greatest) == np.finfo(np.float64).max
    assert distance(np.array([3.0, 4.0]), np.zeros(1)) == 5.0
