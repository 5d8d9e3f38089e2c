"""Particle filters of a network that find false data at the own sensors and tell one another of the rest."""

from __future__ import annotations

from nodes.estimators.likelihood_exchange import LikelihoodExchange
from nodes.estimators.particle_fdi import ParticleFdi


class DistributedParticleFdi(LikelihoodExchange, ParticleFdi):
    """The filter of `ParticleFdi` at each node of a network, with an exchange of the nodes' likelihoods.

    Each node judges the packets of its own sensors and compensates them; what it tells its neighbours is the
    likelihood of what is left (`LikelihoodExchange`). The method goes beyond Sadeghzadeh-Nokhodberiz et al.
    2022, which has one estimator. An attack that a node misses reaches its neighbours too, and what they are
    told is not judged: an adversary on the links between estimators has free play.

    Parameters, and what is refused, are those of `ParticleFdi`, and too few particles to fit a quadratic to.
    """
