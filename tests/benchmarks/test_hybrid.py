"""The two ways that the benchmark of the hybrid Bernoulli filter compares give the same mixtures."""

from __future__ import annotations

import numpy as np

from benchmarks.hybrid import by_arrays, by_loop, problem


def test_the_plain_loop_and_the_arrays_give_the_same_components() -> None:
    small = problem(4, 3)
    for arrays, loop in zip(by_arrays(small), by_loop(small), strict=True):
        assert arrays.size == len(loop) == 4
        np.testing.assert_allclose(arrays.log_weights, [one.log_weight for one in loop], atol=1e-10)
        np.testing.assert_allclose(arrays.means, [one.mean for one in loop], atol=1e-10)
        np.testing.assert_allclose(arrays.covariances, [one.covariance for one in loop], atol=1e-10)
