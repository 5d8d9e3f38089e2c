from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from benchmarks.sampling import sampled
from nodes.gaussian import Gaussian

MATRIX = np.eye(200)


def repeated(work: Callable[[], object], cpu_s: float = 0.3) -> None:
    until = time.process_time() + cpu_s
    while time.process_time() < until:
        for _ in range(5):
            work()


def test_time_in_a_library_counts_for_the_folder_whose_code_called() -> None:
    law = Gaussian(covariance=MATRIX.tolist())
    with sampled() as counts:
        repeated(lambda: law.covariance_matrix(200))
    assert counts["nodes"] > 0.9 * sum(counts.values()) > 0
    with sampled() as counts:
        repeated(lambda: np.linalg.eigvalsh(MATRIX))
    assert counts["tests"] > 0.9 * sum(counts.values()) > 0
    assert counts["nodes"] == 0
