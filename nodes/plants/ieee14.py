"""The IEEE 14-bus network: five machines, of which an attacker alters loads."""

from __future__ import annotations

from nodes.gaussian import Gaussian
from nodes.plants.swing_network import SwingNetwork, machines_of

BRANCHES = (
    (1, 2), (1, 5), (2, 3), (2, 4), (2, 5), (3, 4), (4, 5), (4, 7), (4, 9), (5, 6),
    (6, 11), (6, 12), (6, 13), (7, 8), (7, 9), (9, 10), (9, 14), (10, 11), (12, 13), (13, 14),
)  # fmt: skip
MACHINES = (1, 2, 3, 6, 8)
INERTIAS_S = (5.148, 6.54, 6.54, 5.06, 5.06)
TRANSIENT_REACTANCES = (0.2995, 0.185, 0.185, 0.232, 0.232)


class Ieee14(SwingNetwork):
    """The swing of the five machines of the IEEE 14-bus network, as Forti et al. 2019 (section VI B) read it.

    All branches have the reactance 1 p.u. The machines stand at buses 1, 2, 3, 6 and 8; their inertias,
    transient reactances and damping are the usual ones of the literature, for the paper states none. The
    angles of a network without reference drift freely; the score's groups are ``angles`` (rad) and
    ``frequencies`` (rad/s).

    Parameters
    ----------
    period_s
        Sampling period (s); the paper's is 0.01.
    attacked_buses
        The buses whose loads the signal alters.
    damping
        Damping of each machine (p.u. s).
    attack_scale
        By how much the signal is scaled on its way in.
    process_noise
        Law of the noise of one period, on all ten states; the paper's variance of 0.01 by default.
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
        super().__init__(
            period_s,
            branches=[[one, other, 1.0] for one, other in BRANCHES],
            machines=machines_of(MACHINES, INERTIAS_S, TRANSIENT_REACTANCES, damping),
            process_noise=process_noise or Gaussian(std=0.1),
            initial=initial or Gaussian(std=0.1),
            attacked_buses=[3, 9] if attacked_buses is None else attacked_buses,
            attack_scale=attack_scale,
        )
