"""From the branches and machines of a power network to the swing equation of its generators.

Voltages are 1 p.u. and branches lossless. Behind its transient reactance each machine has an internal node;
eliminating all buses leaves the network that the machines see (Kron reduction; Pasqualetti, Bicchi, Bullo
2011). With injections ``p`` (b,) at the buses, the angles of the buses are ``theta = L_bb^-1 (p - L_bg
delta)`` and the electrical powers of the machines ``(L_gg - L_gb L_bb^-1 L_bg) delta + L_gb L_bb^-1 p``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from nodes.contract import Matrix


class Reduced(NamedTuple):
    """``stiffness`` (g, g) in p.u. per rad, and by how much of a load at each bus each machine's power rises.

    ``load_shares`` is (g, b), with the buses in the order of ``buses``. A column sums to one.
    """

    stiffness: Matrix
    load_shares: Matrix
    buses: Sequence[int]


def laplacian(branches: Sequence[tuple[int, int, float]], buses: Sequence[int]) -> Matrix:
    """Return the Laplacian (b, b) of branches ``(from bus, to bus, reactance in p.u.)``."""
    at = {bus: i for i, bus in enumerate(buses)}
    matrix = np.zeros((len(buses), len(buses)))
    for one, other, reactance in branches:
        if not reactance > 0.0:
            raise ValueError(
                f"branch {one}-{other} has the reactance {reactance}; give a positive one in p.u."
            )
        i, j = at[one], at[other]
        matrix[i, i] += 1.0 / reactance
        matrix[j, j] += 1.0 / reactance
        matrix[i, j] -= 1.0 / reactance
        matrix[j, i] -= 1.0 / reactance
    return matrix


def kron_reduce(branches: Sequence[tuple[int, int, float]], machines: Sequence[tuple[int, float]]) -> Reduced:
    """Return what the machines ``(bus, transient reactance in p.u.)`` see of a connected network.

    Raises
    ------
    ValueError
        When a reactance is not positive, a machine stands at a bus without branch, or some buses see no
        machine.
    """
    buses = sorted({bus for one, other, _ in branches for bus in (one, other)})
    at = {bus: i for i, bus in enumerate(buses)}
    strange = [bus for bus, _ in machines if bus not in at]
    if strange:
        raise ValueError(
            f"machines stand at {strange}, but no branch ends there; add one, or correct the bus"
        )
    if any(not reactance > 0.0 for _, reactance in machines):
        raise ValueError("every machine needs a positive transient reactance in p.u.")
    admittances = np.array([1.0 / reactance for _, reactance in machines])
    among_buses = laplacian(branches, buses)
    links = np.zeros((len(machines), len(buses)))
    for i, (bus, _) in enumerate(machines):
        among_buses[at[bus], at[bus]] += admittances[i]
        links[i, at[bus]] = admittances[i]
    if np.linalg.cond(among_buses) > 1e12:
        raise ValueError("some buses are connected with no machine; add the missing branches")
    shares: Matrix = np.ascontiguousarray(np.linalg.solve(among_buses, links.T).T, dtype=np.float64)
    stiffness = np.diag(admittances) - shares.dot(links.T)
    return Reduced(0.5 * (stiffness + stiffness.T), shares, buses)
