"""A target on a line whose acceleration wanders: the tracking model of Ding 2021, section V."""

from __future__ import annotations

from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear


class ConstantAcceleration(Linear):
    """A linear plant with the state position (m), velocity (m/s), acceleration (m/s^2), in this order.

    Over one period ``T`` the dynamics are ``[[1, T, T^2/2], [0, 1, T], [0, 0, 1]]``. Each component is a
    group of the score under its own name.

    Parameters
    ----------
    period_s
        Sampling period ``T`` (s).
    process_noise
        Law of the noise that one period adds to the three components; its mean must be zero.
    initial
        Law of the three components at step 0.

    Raises
    ------
    ValueError
        When the period is not positive, a law does not have three components, or the process noise has a
        mean.
    """

    def __init__(self, period_s: float, *, process_noise: Gaussian, initial: Gaussian) -> None:
        super().__init__(
            period_s,
            A=[[1.0, period_s, 0.5 * period_s**2], [0.0, 1.0, period_s], [0.0, 0.0, 1.0]],
            process_noise=process_noise,
            initial=initial,
            state_groups={"position": [0], "velocity": [1], "acceleration": [2]},
        )
