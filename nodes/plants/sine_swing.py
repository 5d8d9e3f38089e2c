"""The generators of a power network in swings of any size, under attacks on loads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix
from nodes.gaussian import Gaussian
from nodes.plants.additive import Additive
from nodes.plants.ieee14 import Ieee14
from nodes.plants.swing_network import Machine, SwingNetwork

_LONGEST_STRIDE = 0.1  # product of a stride of the integration and the fastest damping rate D / M


class SineSwing(Additive):
    """The swing equation of machines whose angles may differ by any amount.

    ``M_i delta_i'' + D_i delta_i' + sum_j b_ij sin(delta_i - delta_j) = -(F a)_i``, with the couplings
    ``b_ij = -L_ij`` and the shares ``F`` of a reduced network (`SwingNetwork`, whose state, groups and signal
    it has). Near equal angles both are one; machines more than a quarter turn apart pull each other the less,
    the further they are. A period is integrated by the fourth-order Runge-Kutta method, the signal held, and
    then noise is added.

    Parameters
    ----------
    network
        The small-signal form of the same network.
    process_noise
        Law of the noise that one period adds to the 2 g states.
    """

    def __init__(self, network: SwingNetwork, process_noise: Gaussian) -> None:
        period_s = network.period_s
        super().__init__(period_s, process_noise, network.initial_mean, network.initial_covariance)
        self.state_groups: Mapping[str, Sequence[int]] = network.state_groups
        self.signal_size: int = network.load_shares.shape[1]
        inertias = network.inertias[:, None]
        self._rates = network.damping[:, None] / inertias
        self._pull = (np.diag(network.reduced.stiffness.diagonal()) - network.reduced.stiffness) / inertias
        self._push = -network.load_shares / inertias
        self._strides = max(1, int(np.ceil(period_s * self._rates.max() / _LONGEST_STRIDE)))

    def transition(self, states: Matrix, signals: Matrix | None = None) -> Matrix:
        """Return the states (N, n) one period after states (N, n), under signals (N, q) that are held."""
        load = np.zeros((1, 1)) if signals is None else self._push.dot(signals.T)
        g, h = len(self._rates), self.period_s / self._strides
        now = states.T
        for _ in range(self._strides):
            k1 = self._slope(now, load, g)
            k2 = self._slope(now + 0.5 * h * k1, load, g)
            k3 = self._slope(now + 0.5 * h * k2, load, g)
            k4 = self._slope(now + h * k3, load, g)
            now = now + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
        moved: Matrix = now.T
        return moved

    def advance(
        self, step: int, state: Vector, rng: np.random.Generator, *, attack: Vector | None = None
    ) -> Vector:
        """Return the state (n,) of ``step``, given that of the step before, and the signal since."""
        moved = self.transition(state[None], None if attack is None else attack[None])[0]
        noisy: Vector = moved + self._noise_factor.dot(rng.standard_normal(len(state)))
        return noisy

    def _slope(self, states: Matrix, load: Matrix, g: int) -> Matrix:
        """Return the derivative (2 g, N) at states (2 g, N), with the sine of each difference taken apart."""
        sine, cosine = np.sin(states[:g]), np.cos(states[:g])
        pulled = sine * self._pull.dot(cosine) - cosine * self._pull.dot(sine)
        slope = np.empty_like(states)
        slope[:g] = states[g:]
        slope[g:] = load - self._rates * states[g:] - pulled
        return slope


class SineSwingNetwork(SineSwing):
    """The machines of a network given by its tables, in swings of any size.

    Parameters
    ----------
    period_s
        Sampling period (s).
    branches
        ``[from bus, to bus, reactance in p.u.]`` each; resistances and taps are left out.
    machines
        The generators.
    process_noise
        Law of the noise that one period adds to the 2 g states.
    initial
        Law of the states at step 0.
    attacked_buses
        The buses whose loads the signal alters, in its order; none: no signal.
    attack_scale
        By how much the signal is scaled on its way in.
    nominal_hz
        Nominal frequency ``f`` (Hz); ``M = H / (pi f)``.

    Raises
    ------
    ValueError
        When the tables do not make a network, an inertia is not positive, or an attacked bus is not in it.
    """

    def __init__(
        self,
        period_s: float,
        *,
        branches: list[list[float]],
        machines: list[Machine],
        process_noise: Gaussian,
        initial: Gaussian,
        attacked_buses: list[int] | None = None,
        attack_scale: float = 1.0,
        nominal_hz: float = 60.0,
    ) -> None:
        small_signal = SwingNetwork(
            period_s,
            branches=branches,
            machines=machines,
            process_noise=process_noise,
            initial=initial,
            attacked_buses=attacked_buses,
            attack_scale=attack_scale,
            nominal_hz=nominal_hz,
        )
        super().__init__(small_signal, process_noise)


class SineIeee14(SineSwing):
    """The five machines of the IEEE 14-bus network in swings of any size; all else as in `Ieee14`.

    Parameters
    ----------
    period_s
        Sampling period (s).
    attacked_buses
        The buses whose loads the signal alters.
    damping
        Damping of each machine (p.u. s).
    attack_scale
        By how much the signal is scaled on its way in.
    process_noise
        Law of the noise of one period, on all ten states; a variance of 0.01 by default.
    initial
        Law of the states at step 0.
    """

    def __init__(
        self,
        period_s: float,
        *,
        attacked_buses: list[int] | None = None,
        damping: float = 2.0,
        attack_scale: float = 1.0,
        process_noise: Gaussian | None = None,
        initial: Gaussian | None = None,
    ) -> None:
        small_signal = Ieee14(
            period_s,
            attacked_buses=attacked_buses,
            damping=damping,
            attack_scale=attack_scale,
            initial=initial,
        )
        super().__init__(small_signal, process_noise or Gaussian(std=0.1))
