import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from nodes.filter_gains import FilterGains

A = np.array([[0.95, 0.2], [-0.2, 0.95]])
Q = 0.01 * np.eye(2)
C = np.array([[1.0, 0.0]])
R = np.array([[0.09]])


def test_time_varying_gains_are_those_of_another_librarys_filter():
    kf = KalmanFilter(dim_x=2, dim_z=1)
    kf.F, kf.Q, kf.H, kf.R, kf.P = A, Q, C, R, 2.0 * np.eye(2)
    gains = FilterGains(A, Q, C, R, 2.0 * np.eye(2), "time_varying")
    for step in range(30):
        gain = gains.next()
        if step > 0:
            kf.predict()
        kf.update(np.zeros(1))
        np.testing.assert_allclose(gain.K, kf.K, rtol=1e-9)
        np.testing.assert_allclose(gain.S, kf.S, rtol=1e-9)
        np.testing.assert_allclose(gain.P, kf.P, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(gain.factor @ gain.factor.T, gain.S, rtol=1e-12)


def test_steady_gains_are_their_limit():
    varying = FilterGains(A, Q, C, R, 2.0 * np.eye(2), "time_varying")
    last = [varying.next() for _ in range(200)][-1]
    steady = FilterGains(A, Q, C, R, 2.0 * np.eye(2), "steady").next()
    for settled, limit in zip(last, steady, strict=True):
        np.testing.assert_allclose(settled, limit, rtol=1e-9, atol=1e-12)


def test_a_filter_that_does_not_settle_is_refused_with_the_cure():
    unseen = np.diag([1.1, 0.5])
    with pytest.raises(ValueError, match="does not settle: it must see every mode that does not decay"):
        FilterGains(unseen, Q, np.array([[0.0, 1.0]]), R, np.eye(2), "steady")


def test_singular_noise_is_refused():
    with pytest.raises(ValueError, match="the measurement noise is singular; give it a positive std"):
        FilterGains(A, Q, C, np.zeros((1, 1)), np.eye(2), "steady")
