"""Particle filters of a network that tell one another of their measurements."""

from __future__ import annotations

from nodes.estimators.likelihood_exchange import LikelihoodExchange


class DistributedParticle(LikelihoodExchange):
    """A particle filter at each node of a network, with an exchange of the nodes' likelihoods.

    The filter is that of `Particle`, with its parameters; the exchange that of `LikelihoodExchange`. It
    believes what the neighbours tell.

    Raises
    ------
    ValueError
        When the plant cannot be sampled, a sensor has no likelihood, or the particles are too few to fit a
        quadratic to.
    """
