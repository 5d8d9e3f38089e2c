"""Whether innovations are white, as those of a filter that loses no information are.

The time-average autocorrelation of whitened innovations (Bar-Shalom, Li and Kirubarajan 2001, section 5.4)
at each lag, pooled over trials, is normal with variance one over its number of pairs; together the lags make
a portmanteau test (Ljung and Box 1978, Biometrika 65:297).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.score.gather import Bools, Floats, Ints

LAGS = 10


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation at the lags 1..L: ``correlation`` (L,) is within ``bound`` (L,) when white.

    ``pairs`` (L,) were counted; NaN where there is none. ``p_value`` is that of all lags together.
    """

    correlation: Floats
    bound: Floats
    pairs: Ints
    p_value: float

    def is_white(self, confidence: float = CONFIDENCE) -> bool:
        """Return whether the lags together do not contradict whiteness."""
        return not self.p_value < 1.0 - confidence


def whiteness(
    innovation: Floats, counted: Bools | None = None, lags: int = LAGS, confidence: float = CONFIDENCE
) -> Whiteness:
    """Return the autocorrelation of whitened innovations (N, K, M), NaN where a component did not come.

    Of N trials, K steps and M components, pairs count where both steps are ``counted`` (N, K) and both
    components came.
    """
    from scipy.special import chdtrc, ndtri

    if counted is not None:
        innovation = np.where(counted[:, :, None], innovation, np.nan)
    correlation, pairs = np.full(lags, np.nan), np.zeros(lags, dtype=np.int64)
    for lag in range(1, min(lags, innovation.shape[1] - 1) + 1):
        earlier, later = innovation[:, :-lag], innovation[:, lag:]
        both = np.isfinite(earlier) & np.isfinite(later)
        pairs[lag - 1] = both.sum()
        earlier, later = earlier[both], later[both]
        scale = np.sqrt(np.sum(earlier**2) * np.sum(later**2))
        if scale > 0.0:
            correlation[lag - 1] = np.sum(earlier * later) / scale
    known = ~np.isnan(correlation)
    reach = np.full(lags, np.nan)
    reach[known] = ndtri((1.0 + confidence) / 2.0) / np.sqrt(pairs[known])
    statistic = float(np.sum(pairs[known] * correlation[known] ** 2))
    p_value = float(chdtrc(known.sum(), statistic)) if known.any() else np.nan
    return Whiteness(correlation, reach, pairs, p_value)


def standardised_nis(nis: Floats, dof: Ints) -> Floats:
    """Return NIS (N, K) less its mean over its deviation, as (N, K, 1): white for a consistent filter too.

    It sees only the size of innovations: a correlation ``r`` of these shows as about ``r^2`` in it, so it
    finds less than the innovations themselves would.
    """
    some = (dof > 0) & np.isfinite(nis)
    degrees = np.where(some, dof, 1)
    return np.where(some, (nis - degrees) / np.sqrt(2.0 * degrees), np.nan)[:, :, None]
