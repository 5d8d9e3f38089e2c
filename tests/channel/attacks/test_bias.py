from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bus.packets import Packet
from channel.attacks.bias import Bias
from channel.contract import Ledger, Placement, Slot


def bias(**parameters: Any) -> Bias:
    return Bias(Placement("bias", {"s4->e4": "s4->e4"}, {}), **parameters)


def test_the_bias_is_added_and_noted_and_the_genuine_packet_left_alone() -> None:
    ledger = Ledger()
    genuine = Packet("s4", 7, 7, "measurement", np.array([1.0, 2.0]))
    (false,) = bias(value=[3.0, 4.0]).lane("s4->e4").act(Slot(7, 0, 7), [genuine], ledger)
    assert false.values.tolist() == [4.0, 6.0]
    assert genuine.values.tolist() == [1.0, 2.0]
    assert (false.source, false.sent_step, false.sequence) == ("s4", 7, 7)
    assert ledger.events == [("s4->e4", "bias", 7, "attacked", 5.0)]


def test_only_the_named_components_are_attacked() -> None:
    genuine = Packet("s4", 7, 7, "measurement", np.array([1.0, 2.0, 3.0]))
    (false,) = bias(value=10.0, components=[2]).lane("s4->e4").act(Slot(7, 0, 7), [genuine], Ledger())
    assert false.values.tolist() == [1.0, 2.0, 13.0]


@pytest.mark.parametrize("parameters", [{"value": [1.0, 2.0]}, {"value": 1.0, "components": [4]}])
def test_a_bias_that_does_not_fit_the_payload_names_the_link(parameters: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="s4->e4 does not fit a payload of 3 values"):
        bias(**parameters).lane("s4->e4").act(
            Slot(0, 0, 0), [Packet("s4", 0, 0, "measurement", np.zeros(3))], Ledger()
        )


def test_as_many_values_as_components_are_demanded() -> None:
    with pytest.raises(ValueError, match="2 entries for 1 components"):
        bias(value=[1.0, 2.0], components=[0])
