import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from nodes.contract import LinearPlant
from nodes.gaussian import Gaussian
from nodes.linear_algebra import matrix_exponential
from nodes.plants.ieee14 import Ieee14
from nodes.plants.kron_reduction import kron_reduce
from nodes.plants.swing_network import Machine, SwingNetwork, machines_of

NEW_ENGLAND = """
1 2 .0411  1 39 .025  2 3 .0151  2 25 .0086  2 30 .0181  3 4 .0213  3 18 .0133  4 5 .0128  4 14 .0129
5 6 .0026  5 8 .0112  6 7 .0092  6 11 .0082  6 31 .025  7 8 .0046  8 9 .0363  9 39 .025  10 11 .0043
10 13 .0043  10 32 .02  12 11 .0435  12 13 .0435  13 14 .0101  14 15 .0217  15 16 .0094  16 17 .0089
16 19 .0195  16 21 .0135  16 24 .0059  17 18 .0082  17 27 .0173  19 20 .0138  19 33 .0142  20 34 .018
21 22 .014  22 23 .0096  22 35 .0143  23 24 .035  23 36 .0272  25 26 .0323  25 37 .0232  26 27 .0147
26 28 .0474  26 29 .0625  28 29 .0151  29 38 .0156
"""
"""The branches of the 39-bus New England network: from bus, to bus, reactance (p.u. on 100 MVA)."""
NEW_ENGLAND_MACHINES = {
    "buses": [30, 31, 32, 33, 34, 35, 36, 37, 38, 39],
    "H": [42.0, 30.3, 35.8, 28.6, 26.0, 34.8, 26.4, 24.3, 34.5, 500.0],
    "xd": [0.031, 0.0697, 0.0531, 0.0436, 0.132, 0.05, 0.049, 0.057, 0.057, 0.006],
}


def new_england():
    numbers = NEW_ENGLAND.split()
    branches = [[float(x) for x in numbers[i : i + 3]] for i in range(0, len(numbers), 3)]
    return SwingNetwork(
        0.01,
        branches=branches,
        machines=machines_of(**NEW_ENGLAND_MACHINES, damping=0.05),
        process_noise=Gaussian(std=0.0),
        initial=Gaussian(std=0.0),
        attacked_buses=[16, 21, 39],
    )


def test_the_14_bus_network_reduces_to_its_check_values():
    plant = Ieee14(0.01)
    np.testing.assert_allclose(plant.inertias, [0.027311, 0.034696, 0.034696, 0.026844, 0.026844], atol=5e-7)
    expected = [
        [1.03043, -0.6114, -0.15841, -0.20911, -0.0515],
        [-0.6114, 1.77358, -0.70547, -0.31628, -0.14043],
        [-0.15841, -0.70547, 1.16541, -0.17386, -0.12767],
        [-0.20911, -0.31628, -0.17386, 0.85078, -0.15152],
        [-0.0515, -0.14043, -0.12767, -0.15152, 0.47112],
    ]
    np.testing.assert_allclose(plant.reduced.stiffness, expected, atol=6e-6)
    shares = plant.reduced.load_shares[:, [plant.reduced.buses.index(bus) for bus in (3, 9)]]
    np.testing.assert_allclose(
        shares,
        [[0.02931, 0.07449], [0.13051, 0.19185], [0.7844, 0.16938], [0.03216, 0.34518], [0.02362, 0.2191]],
        atol=6e-6,
    )
    assert isinstance(plant, LinearPlant)
    assert plant.state_groups == {"angles": [0, 1, 2, 3, 4], "frequencies": [5, 6, 7, 8, 9]}


@pytest.mark.parametrize("make", [lambda: Ieee14(0.01), new_england])
def test_a_reduced_network_passes_on_all_power_and_feels_differences_of_angles_only(make):
    plant = make()
    np.testing.assert_allclose(plant.reduced.stiffness.sum(axis=1), 0.0, atol=1e-9)
    np.testing.assert_allclose(plant.reduced.load_shares.sum(axis=0), 1.0, rtol=1e-9)
    assert np.linalg.eigvalsh(plant.reduced.stiffness)[1] > 0.0
    assert (plant.reduced.load_shares >= 0.0).all()


def test_the_39_bus_network_agrees_with_the_elimination_of_one_bus_after_the_other():
    plant = new_england()
    numbers = NEW_ENGLAND.split()
    nodes = 39 + 10
    whole = np.zeros((nodes, nodes))
    lines = [(int(numbers[i]) - 1, int(numbers[i + 1]) - 1, float(numbers[i + 2])) for i in range(0, 138, 3)]
    machines = zip(NEW_ENGLAND_MACHINES["buses"], NEW_ENGLAND_MACHINES["xd"], strict=True)
    lines += [(bus - 1, 39 + i, x) for i, (bus, x) in enumerate(machines)]
    for i, j, x in lines:
        whole[[i, j], [i, j]] += 1.0 / x
        whole[[i, j], [j, i]] -= 1.0 / x
    for _ in range(39):  # a star becomes a mesh
        whole = whole[1:, 1:] - np.outer(whole[1:, 0], whole[0, 1:]) / whole[0, 0]
    np.testing.assert_allclose(plant.reduced.stiffness, whole, rtol=1e-9, atol=1e-9)
    assert plant.A.shape == (20, 20)
    assert plant.G.shape == (20, 3)
    # The machines' own frequencies of swing, which are known to lie between 1 and 10 rad/s here.
    modes = np.sqrt(np.abs(np.linalg.eigvals(plant.reduced.stiffness / plant.inertias[:, None])))
    assert 3.0 < np.sort(modes)[1] < np.sort(modes)[-1] < 12.0
    assert np.abs(np.linalg.eigvals(plant.A)).max() < 1.0 + 1e-6


def test_a_sampled_network_follows_the_swing_equation_under_an_altered_load():
    plant = Ieee14(0.01, process_noise=Gaussian(std=0.0))
    M, L = plant.inertias, plant.reduced.stiffness
    F = plant.reduced.load_shares[:, [plant.reduced.buses.index(bus) for bus in (3, 9)]]
    load = np.array([0.2, 0.1])

    def swing(_, x):
        return np.concatenate((x[5:], (-2.0 * x[5:] - L @ x[:5] - F @ load) / M))

    rng, state = np.random.default_rng(0), np.linspace(-0.2, 0.2, 10)
    exact = solve_ivp(swing, (0.0, 0.5), state, rtol=1e-11, atol=1e-12).y[:, -1]
    for step in range(1, 51):
        state = plant.advance(step, state, rng, attack=load)
    np.testing.assert_allclose(state, exact, rtol=1e-8, atol=1e-9)


def test_the_exponential_is_that_of_another_library():
    rng = np.random.default_rng(1)
    for scale in (0.0, 1e-3, 1.0, 30.0):
        matrix = scale * rng.normal(size=(6, 6))
        np.testing.assert_allclose(matrix_exponential(matrix), expm(matrix), rtol=1e-9, atol=1e-12)


def test_the_attack_can_be_scaled_or_absent():
    np.testing.assert_allclose(Ieee14(0.01, attack_scale=50.0).G, 50.0 * Ieee14(0.01).G)
    assert Ieee14(0.01, attacked_buses=[]).G.shape == (10, 0)


def test_tables_that_make_no_network_are_refused():
    with pytest.raises(ValueError, match=r"machines stand at \[9\]"):
        kron_reduce([(1, 2, 1.0)], [(9, 0.1)])
    with pytest.raises(ValueError, match=r"1-2 has the reactance 0\.0"):
        kron_reduce([(1, 2, 0.0)], [(1, 0.1)])
    with pytest.raises(ValueError, match="positive transient reactance"):
        kron_reduce([(1, 2, 1.0)], [(1, 0.0)])
    with pytest.raises(ValueError, match="connected with no machine"):
        kron_reduce([(1, 2, 1.0), (3, 4, 1.0)], [(1, 0.1)])
    laws = {"process_noise": Gaussian(std=0.1), "initial": Gaussian(std=0.1)}
    machines = [Machine(1, 5.0, 0.2, 1.0)]
    with pytest.raises(ValueError, match=r"attacked_buses: \[7\] are not in the network; it has \[1, 2\]"):
        SwingNetwork(0.01, branches=[[1, 2, 1.0]], machines=machines, attacked_buses=[7], **laws)
    with pytest.raises(ValueError, match="a branch is"):
        SwingNetwork(0.01, branches=[[1, 2]], machines=machines, **laws)
    with pytest.raises(ValueError, match="a positive inertia"):
        SwingNetwork(0.01, branches=[[1, 2, 1.0]], machines=[Machine(1, 0.0, 0.2, 1.0)], **laws)
