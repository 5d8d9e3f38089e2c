"""The two ways that the benchmark of the particle filter compares give the same estimates."""

from __future__ import annotations

import numpy as np

from benchmarks.particles import attacked, by_estimator, by_loop


def test_the_plain_loop_and_the_estimator_as_published_give_the_same_estimates() -> None:
    of = attacked(40)
    ours = by_estimator(of, 100, "particle_fdi as published")()
    np.testing.assert_allclose(ours, by_loop(of, 100)(), rtol=0.0, atol=1e-8)
