"""What nodes of an event-triggered distributed filter tell one another, and what they remember of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Matrix
from nodes.lapack import dpotrf

SENT, QUIET, UNMEASURED = 1.0, 0.0, -1.0


class Layout:
    """How a payload is laid out: estimate (n), upper triangle of its bound, flag, slack, innovation (m).

    The flag is `SENT`, `QUIET` or `UNMEASURED`; the innovation is there when it is `SENT`. The slack is the
    largest that ``f' Phi f`` can be of ``f``, the innovation less the one last sent; 0 when it is sent.
    """

    def __init__(self, states: int, outputs: int) -> None:
        self.states, self.outputs = states, outputs
        self._upper = np.triu_indices(states)
        self._triangle = slice(states, states + len(self._upper[0]))
        self.flag = self._triangle.stop
        self.quiet = self.flag + 2
        self.full = self.quiet + outputs

    def payload(self, state: Vector, bound: Matrix, flag: float, slack: float, sent: Vector | None) -> Vector:
        """Return the payload of one slot."""
        parts = [state, bound[self._upper], np.array([flag, slack])]
        return np.concatenate(parts if sent is None else [*parts, sent])

    def fits(self, values: Vector) -> bool:
        """Return whether a payload can be one of this method."""
        size = self.full if values.size > self.flag and values[self.flag] == SENT else self.quiet
        return values.size == size and values[self.flag + 1] >= 0.0

    def read(self, payloads: Sequence[Vector]) -> tuple[Matrix, np.ndarray, Vector]:
        """Return states (M, n), bounds (M, n, n) and slacks (M,) of payloads."""
        fixed = np.array([values[: self.quiet] for values in payloads])
        bounds = np.empty((len(fixed), self.states, self.states))
        rows, columns = self._upper
        bounds[:, rows, columns] = bounds[:, columns, rows] = fixed[:, self._triangle]
        return np.ascontiguousarray(fixed[:, : self.states]), bounds, fixed[:, self.flag + 1]


class Heard(NamedTuple):
    """A node itself, and then the neighbours that it can use in a step.

    ``names`` are the neighbours' alone; the rest, states, bounds, slacks and last sent innovations, has a row
    for each member.
    """

    names: tuple[str, ...]
    states: Matrix
    bounds: np.ndarray
    slacks: Vector
    innovations: Matrix


class Memory:
    """The innovation that each neighbour last sent, as far as the node has it.

    When a packet is lost, the node cannot know whether the neighbour has sent another: it forgets it, and the
    neighbour is left out until it sends again. So is one whose payload is malformed (a bound that is not
    positive definite, for one). A neighbour that lacks a measurement is left out of that step.
    """

    def __init__(self, layout: Layout, neighbours: Iterable[str]) -> None:
        self._layout = layout
        self._neighbours = sorted(neighbours)
        self._last: dict[str, Vector] = {}

    @property
    def innovations(self) -> Mapping[str, Vector]:
        """The innovations (m,) that count, by neighbour."""
        return self._last

    def take(self, step: int, own: Vector, last: Vector, packets: Sequence[Packet]) -> Heard:
        """Take the neighbours' slots of a step; of several packets from one of them the last counts.

        ``own`` is the node's own payload, and ``last`` the innovation that it last sent.
        """
        layout, known = self._layout, self._last
        arrived = {p.source: p.values for p in packets if p.sent_step == step and layout.fits(p.values)}
        names = []
        for name in self._neighbours:
            values = arrived.get(name)
            if values is None:
                known.pop(name, None)
                continue
            if values.size == layout.full:
                known[name] = values[layout.quiet :]
            if name in known and values[layout.flag] != UNMEASURED:
                names.append(name)
        states, bounds, slacks = layout.read([own, *[arrived[name] for name in names]])
        indefinite = [name for name, bound in zip(names, bounds[1:], strict=True) if dpotrf(bound)[1] != 0]
        if indefinite:
            return self.take(step, own, last, [p for p in packets if p.source not in indefinite])
        innovations = np.array([last, *[known[name] for name in names]])
        return Heard(tuple(names), states, bounds, slacks, innovations)
