import numpy as np
import pytest

from bus.packets import Packet
from nodes.estimators.commanded_input import CommandedInput
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear


def plant(holds_input=False):
    return Linear(
        1.0,
        A=[[1.0, 0.0], [0.0, 1.0]],
        B=[[1.0], [2.0]],
        process_noise=Gaussian(std=0.0),
        initial=Gaussian(std=0.0),
        holds_input=holds_input,
    )


def command(step, *values):
    return Packet("c1", step, step, "control", np.array(values))


def test_before_anything_is_commanded_it_adds_nothing_to_a_prediction():
    assert CommandedInput(plant()).effect is None


def test_the_newest_command_counts():
    commanded = CommandedInput(plant())
    commanded.take([command(4, 10.0), command(3, 1.0)])
    np.testing.assert_array_equal(commanded.effect, [10.0, 20.0])


@pytest.mark.parametrize(("holds", "effect"), [(False, [0.0, 0.0]), (True, [10.0, 20.0])])
def test_a_lost_command_counts_as_it_does_in_the_plant(holds, effect):
    commanded = CommandedInput(plant(holds))
    commanded.take([])
    np.testing.assert_array_equal(commanded.effect, [0.0, 0.0])
    commanded.take([command(1, 10.0)])
    commanded.take([])
    np.testing.assert_array_equal(commanded.effect, effect)


def test_a_command_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"an input has the shape \(2,\), not \(1,\)"):
        CommandedInput(plant()).take([command(0, 1.0, 2.0)])
