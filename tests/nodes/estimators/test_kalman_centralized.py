import numpy as np
from filterpy.kalman import KalmanFilter
from scipy.linalg import block_diag

from nodes.estimators.kalman import Kalman
from nodes.estimators.kalman_centralized import KalmanCentralized


def test_it_listens_to_every_sensor_unless_told_otherwise():
    assert KalmanCentralized.listens == "all"


def test_it_equals_the_filter_of_another_library_on_the_stacked_measurements(world):
    centralised = KalmanCentralized(world.setting("s1", "s2"))
    kf = KalmanFilter(dim_x=3, dim_z=3)
    kf.x, kf.P = world.plant.initial_mean.copy(), world.plant.initial_covariance.copy()
    kf.F, kf.Q = world.plant.A, world.plant.Q
    kf.H = np.concatenate([sensor.C for sensor in world.sensors.values()])
    kf.R = block_diag(*[sensor.R for sensor in world.sensors.values()])
    _, packets = world.trial(3, 40)
    for step, inbox in enumerate(packets):
        centralised.correct(step, inbox)
        if step > 0:
            kf.predict()
        kf.update(np.concatenate([p.values for p in inbox]))
        belief = centralised.estimate(step)
        np.testing.assert_allclose(belief.state, kf.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.covariance, kf.P, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.nis, kf.mahalanobis**2, rtol=1e-9)


def test_no_filter_of_part_of_the_sensors_claims_a_smaller_covariance(world):
    centralised = KalmanCentralized(world.setting("s1", "s2"))
    local = Kalman(world.setting("s1"))
    _, packets = world.trial(4, 30)
    for step, inbox in enumerate(packets):
        centralised.correct(step, inbox)
        local.correct(step, inbox[:1])
        gap = local.estimate(step).covariance - centralised.estimate(step).covariance
        assert np.linalg.eigvalsh(gap)[0] > -1e-12
