"""The generators of a power network in small-signal swing, under attacks on loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nodes.contract import Matrix
from nodes.gaussian import Gaussian
from nodes.linear_algebra import matrix_exponential
from nodes.plants.kron_reduction import kron_reduce
from nodes.plants.linear import Linear


@dataclass(frozen=True)
class Machine:
    """A generator: ``bus``, inertia ``H`` (s), transient reactance ``xd`` (p.u.), ``damping`` (p.u. s)."""

    bus: int
    H: float
    xd: float
    damping: float


class SwingNetwork(Linear):
    """The linearised swing equation ``M delta'' + D delta' + L delta = -F a`` of a network's machines.

    The state is the rotor angles (rad) and then the frequencies (rad/s) of the machines, as deviations from
    the steady state, in the order in which the machines are listed. The signal ``a`` (q,) is the additional
    load (p.u.) at the attacked buses. ``L`` and ``F`` follow from the branches by Kron reduction; sampling is
    exact for a load that is constant over a period.

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
        if any(len(branch) != 3 for branch in branches):
            raise ValueError("a branch is [from bus, to bus, reactance in p.u.]")
        if not machines or any(not machine.H > 0.0 for machine in machines):
            raise ValueError("give machines, each with a positive inertia H in seconds")
        lines = [(int(one), int(other), reactance) for one, other, reactance in branches]
        self.reduced = kron_reduce(lines, [(machine.bus, machine.xd) for machine in machines])
        self.inertias = np.array([machine.H / (np.pi * nominal_hz) for machine in machines])
        self.damping = np.array([machine.damping for machine in machines])
        attacked = attacked_buses or []
        strange = [bus for bus in attacked if bus not in self.reduced.buses]
        if strange:
            raise ValueError(f"attacked_buses: {strange} are not in the network; it has {self.reduced.buses}")
        columns = [self.reduced.buses.index(bus) for bus in attacked]
        self.load_shares: Matrix = attack_scale * self.reduced.load_shares[:, columns]
        A, G = _sampled(period_s, self.reduced.stiffness, self.inertias, self.damping, self.load_shares)
        g = len(machines)
        super().__init__(
            period_s,
            A=A.tolist(),
            process_noise=process_noise,
            initial=initial,
            state_groups={"angles": list(range(g)), "frequencies": list(range(g, 2 * g))},
            G=G.tolist() if attacked else None,
        )


def _sampled(
    period_s: float, stiffness: Matrix, inertias: np.ndarray, damping: np.ndarray, shares: Matrix
) -> tuple[Matrix, Matrix]:
    """Return ``A`` (2 g, 2 g) and ``G`` (2 g, q) over one period, the signal held."""
    g, q = shares.shape
    generator = np.zeros((2 * g + q, 2 * g + q))
    generator[:g, g : 2 * g] = np.eye(g)
    generator[g : 2 * g, :g] = -stiffness / inertias[:, None]
    generator[g : 2 * g, g : 2 * g] = -np.diag(damping / inertias)
    generator[g : 2 * g, 2 * g :] = -shares / inertias[:, None]
    moved = matrix_exponential(period_s * generator)
    return moved[: 2 * g, : 2 * g], moved[: 2 * g, 2 * g :]


def machines_of(
    buses: Sequence[int], H: Sequence[float], xd: Sequence[float], damping: float
) -> list[Machine]:
    """Return machines from columns of a table."""
    return [
        Machine(bus, inertia, reactance, damping)
        for bus, inertia, reactance in zip(buses, H, xd, strict=True)
    ]
