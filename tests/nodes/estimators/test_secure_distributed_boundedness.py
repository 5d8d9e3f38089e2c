import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from nodes.estimators.secure_distributed_boundedness import (
    boundedness,
    largest_bounded_coupling,
    sufficient_condition,
)


def models(network):
    """Return the sensors' (C, R) and the adjacency of the network, in the order of its nodes."""
    names = list(network.neighbours)
    adjacency = np.array([[float(b in network.neighbours[a]) for b in names] for a in names])
    sensors = [network.sensors["s" + name[1:]] for name in names]
    return [(sensor.C, sensor.R) for sensor in sensors], adjacency


def test_the_papers_condition_fails_on_the_papers_own_example(network):
    sensors, adjacency = models(network)
    condition = sufficient_condition(
        network.plant.A,
        [C for C, _ in sensors],
        failure=0.1,
        recovery=0.92,
        coupling=0.004,
        degrees=adjacency.sum(axis=1).astype(int).tolist(),
        threshold=25.0,
    )
    assert round(condition.zeta, 3) == 2.198
    assert round(condition.xi_p, 3) == 2.445
    assert round(condition.xi_q, 3) == 2.447
    assert not condition.holds


def test_the_condition_holds_for_a_plant_that_shrinks_fast():
    shrinking = 0.5 * np.eye(2)
    condition = sufficient_condition(
        shrinking, [np.eye(2)], failure=0.1, recovery=0.9, coupling=0.0, degrees=[2], threshold=25.0
    )
    assert condition.holds
    assert condition.xi_p == pytest.approx(condition.zeta * 0.25, rel=1e-12)


def test_without_coupling_the_bound_settles_at_the_riccati_equation_of_each_node(network):
    sensors, adjacency = models(network)
    A, Q = network.plant.A, network.plant.Q
    result = boundedness(A, Q, sensors, adjacency, 0.0)
    assert result.bounded
    assert result.rate < 1.0
    for (C, R), trace in zip(sensors, result.traces, strict=True):
        P = solve_discrete_are(A.T, C.T, Q, R)
        corrected = P - P @ C.T @ np.linalg.solve(C @ P @ C.T + R, C @ P)
        assert trace == pytest.approx(np.trace(corrected), rel=1e-6)


def test_sensors_with_different_numbers_of_outputs_may_be_mixed(network):
    A, Q = network.plant.A, network.plant.Q
    sensors = [(np.eye(3)[:1], 0.01 * np.eye(1)), (np.eye(3), 0.01 * np.eye(3))]
    apart = [boundedness(A, Q, [sensor], np.zeros((1, 1)), 0.0).traces[0] for sensor in sensors]
    together = boundedness(A, Q, sensors, np.zeros((2, 2)), 0.0).traces
    assert together == pytest.approx(apart, rel=1e-6)


def test_the_bound_of_the_papers_example_stays_finite_and_that_of_a_stronger_coupling_does_not(network):
    sensors, adjacency = models(network)
    A, Q = network.plant.A, network.plant.Q
    assert boundedness(A, Q, sensors, adjacency, 0.004).bounded
    too_strong = boundedness(A, Q, sensors, adjacency, 0.02)
    assert not too_strong.bounded
    assert too_strong.rate > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("graph_seed", [0, 1, 2, 16])
def test_the_limit_of_the_coupling_is_near_seven_hundredths_of_the_inverse_spectral_radius(
    build_network, graph_seed
):
    network = build_network(graph_seed=graph_seed)
    sensors, adjacency = models(network)
    limit = largest_bounded_coupling(network.plant.A, network.plant.Q, sensors, adjacency)
    radius = np.abs(np.linalg.eigvals(adjacency + np.eye(20))).max()
    assert 0.062 < limit * radius < 0.075
