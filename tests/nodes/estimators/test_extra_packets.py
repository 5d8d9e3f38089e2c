"""Extra, malformed, copied and foreign packets: no estimator dies of them, and genuine ones still count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bus.packets import Packet
from nodes.estimators.fixed_gain_consensus import FixedGainConsensus
from nodes.estimators.kalman import Kalman
from nodes.estimators.secure_distributed import SecureDistributed

MAKERS = {
    "kalman": Kalman,
    "fixed_gain_consensus": lambda setting: FixedGainConsensus(setting, gain=[0.2, 0.2, 0.2], coupling=0.1),
    "secure_distributed": lambda setting: SecureDistributed(setting, coupling=0.1),
}


def measured(*values: float, source: str = "s1", step: int = 0) -> Packet:
    return Packet(source, step, step, "measurement", np.array(values))


@pytest.fixture(params=MAKERS)
def make(request, world):
    setting = replace(world.setting("s1"), neighbours={"e2": 0.5, "e3": 0.5})
    return lambda: MAKERS[request.param](setting)


def corrected(estimator, *packets):
    estimator.correct(0, packets)
    return estimator.estimate(0)


def test_malformed_foreign_and_old_packets_change_nothing(make):
    others = [measured(1.0, 2.0), measured(), measured(1.0, source="s9"), measured(1.0, step=-1)]
    plain, disturbed = corrected(make(), measured(1.0)), corrected(make(), *others, measured(1.0))
    assert np.array_equal(plain.state, disturbed.state)
    assert plain.nis_dof == disturbed.nis_dof == 1


def test_a_copy_counts_once_and_different_packets_of_one_sensor_all_count(make):
    copied = corrected(make(), measured(1.0), measured(1.0))
    assert np.array_equal(copied.state, corrected(make(), measured(1.0)).state)
    assert corrected(make(), measured(1.0), measured(1.5), measured(0.5)).nis_dof == 3


def test_each_packet_of_a_sensor_has_a_verdict_of_its_own(world):
    estimator = SecureDistributed(world.setting("s1"), coupling=0.0)
    likely = world.sensors["s1"].C @ world.plant.initial_mean
    belief = corrected(estimator, measured(1e6), measured(*likely), measured(-1e6))
    assert [detection.alarm for detection in belief.detections] == [True, False, True]


def test_malformed_payloads_of_neighbours_are_not_used_and_the_last_of_several_counts(make):
    def exchanged(*sent):
        estimator = make()
        own = estimator.correct(0, [measured(1.0)])
        if own is None:
            pytest.skip("it has no neighbours")
        packets = [Packet("e2", 0, 0, "exchange", values(own)) for values in sent]
        estimator.exchange(0, 0, packets)
        estimator.correct(1, [])
        return estimator.estimate(1).state

    def same(own):
        return own

    def false(own):
        return own + 5.0

    def malformed(own):
        return own[:-1]

    assert np.array_equal(exchanged(malformed, false, same), exchanged(same))
    assert not np.array_equal(exchanged(same, false), exchanged(same))
