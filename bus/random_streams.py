"""Addressed random streams: the same address always gives the same draws, whoever else draws.

An address is (seed, trial, name, purpose). Names are hashed with BLAKE2, which is stable over processes and
versions, and the generator is counter-based, so adding a node, an attack or an estimator shifts nobody's
draws.
"""

from __future__ import annotations

import hashlib

import numpy as np


def random_stream(seed: int, trial: int, name: str, purpose: str) -> np.random.Generator:
    """Return the generator of one address.

    Parameters
    ----------
    seed, trial
        The run's seed and the number of the trial in a campaign; both at least 0.
    name
        The node, link or shared stream that draws.
    purpose
        What the draws are for, for example ``process_noise``: one name may own several streams.
    """
    digest = hashlib.blake2b(f"{name}\x00{purpose}".encode(), digest_size=16).digest()
    words = tuple(int.from_bytes(digest[at : at + 4], "little") for at in range(0, 16, 4))
    sequence = np.random.SeedSequence(entropy=seed, spawn_key=(trial, *words))
    return np.random.Generator(np.random.Philox(sequence))


def sequential_streams(stream: np.random.Generator, number: int) -> list[np.random.Generator]:
    """Return generators of a stream's own, for who draws much and always in one order.

    They are seeded by the stream's address as its spawned children would be, and draw normal numbers in two
    thirds of the time (SFC64); no counter addresses their draws.
    """
    seeds = stream.bit_generator.seed_seq.spawn(number)  # type: ignore[attr-defined]
    return [np.random.Generator(np.random.SFC64(seed)) for seed in seeds]
