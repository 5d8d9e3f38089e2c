"""The centralised Kalman filter: the bound that a distributed method is measured against."""

from __future__ import annotations

from typing import ClassVar

from nodes.contract import Listens
from nodes.estimators.kalman import Kalman


class KalmanCentralized(Kalman):
    """The Kalman filter that listens to every sensor of the network.

    With no loss and no attack no other estimator of the same data has a smaller error covariance. Its
    mathematics is that of `Kalman`; only whom it listens to, unless the topology says otherwise, differs.
    """

    listens: ClassVar[Listens] = "all"
