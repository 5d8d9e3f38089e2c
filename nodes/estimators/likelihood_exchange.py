"""Particle filters that tell their neighbours of their measurements, whatever the sensors."""

from __future__ import annotations

from collections.abc import Sequence

from bus.packets import Packet, Vector
from nodes.estimators.likelihood_summary import Summary, evaluate, packed, summarise, terms, unpacked
from nodes.estimators.particle import Particle


class LikelihoodExchange(Particle):
    """The exchange of a particle filter with its neighbours: one round, a summary of the local likelihood.

    Each filter weighs its particles by its own measurement, tells the neighbours the quadratic nearest to its
    log-likelihood, and weighs them again by what the neighbours tell. Measurements are independent given the
    state, and nobody tells what it heard: so no information counts twice, and the weights are those of the
    posterior on the measurements of the node and its neighbours, whatever the graph and whichever packets
    are lost. On a complete graph that is the centralised filter (surveyed in Hlinka, Hlawatsch,
    Djuric 2013, "Distributed particle filtering in agent networks", IEEE Signal Process. Mag. 30(1)).

    A packet holds what `nodes.estimators.likelihood_summary.packed` makes. A lost one counts as no
    measurement, as does one that was sent in an earlier step, that has another size, or whose curvature has
    the wrong sign; of several from one neighbour the last counts.
    """

    rounds: int = 1
    _told: Vector | None = None
    _received: int = 0

    @staticmethod
    def least_particles(n: int) -> int:
        """Return the number of particles that a quadratic of n variables can be fitted to."""
        return 2 * terms(n)

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Move the particles, weigh them by the own measurements, and return the summary of these."""
        self._told, self._received = None, 0
        super().correct(step, packets)
        if self._told is None:
            return None
        summary = summarise(self._states, self._told)
        return None if summary is None else packed(summary)

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Weigh the particles by what the neighbours tell of their measurements."""
        heard = self._heard(step, packets)
        for summary in heard:
            super()._multiply(evaluate(summary, self._states))
        if heard:
            self._normalise()
        self._received = len(heard)
        return None

    def _diagnostics(self) -> dict[str, float]:
        """Add ``neighbours_received``, the neighbours that arrived."""
        return super()._diagnostics() | {"neighbours_received": float(self._received)}

    def _multiply(self, log_likelihood: Vector) -> None:
        """Multiply the weights by the likelihood of an own measurement, and keep it for the neighbours."""
        self._told = log_likelihood if self._told is None else self._told + log_likelihood
        super()._multiply(log_likelihood)

    def _heard(self, step: int, packets: Sequence[Packet]) -> list[Summary]:
        """Return the usable summaries of the neighbours, in the order of their names."""
        last = {packet.source: packet.values for packet in packets if packet.sent_step == step}
        n = self._states.shape[1]
        summaries = [unpacked(last[source], n) for source in sorted(last)]
        return [summary for summary in summaries if summary is not None]
