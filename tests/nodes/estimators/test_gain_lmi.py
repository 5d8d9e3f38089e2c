"""The gains by semidefinite programs: what they claim, whether solvers agree, and what a failure costs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cvxpy", reason="the extra 'lmi' is not installed")
pytest.importorskip("clarabel", reason="the extra 'lmi' is not installed")

from nodes.estimators import gain_programs
from nodes.estimators.event_triggered_extended_kalman import GainDesign
from nodes.estimators.gain_knowledge import Deception, Shares
from nodes.estimators.gain_lmi import Lmi, as_moments, dead_reckoning_bound, scaled
from nodes.estimators.gain_programs import SLACK
from nodes.estimators.gain_riccati import Riccati
from nodes.remainders import drawn_within
from orchestrator.topology.load import load_topology
from orchestrator.topology.problems import TopologyError
from tests.nodes.estimators.camera_network import ATTACK, cameras, drive, locals_of

FOLDER = Path(__file__).parents[3] / "topologies" / "zhou2020"
Q = np.diag([0.02, 0.02, 0.01]) ** 2
PAPER = Shares.of(ATTACK, 2)
MILD = Deception(low=0.0, high=0.3, value=1.0)


def design(variant, members=3, shares=PAPER, **more):
    return Lmi(shares, Q, variant=variant, members=members, weights=np.ones(3), **more)


@pytest.fixture(scope="module")
def known():
    """What three nodes knew in four steps."""
    return locals_of(cameras(3), 4, 5.0)


@pytest.mark.parametrize("variant", ["nominal", "moment", "sector"])
def test_the_programs_are_compiled_once_and_their_bounds_satisfy_their_inequalities(known, variant):
    lmi = design(variant)
    programs = []
    for local in known[::4]:
        program, _ = lmi.program(local)
        found = lmi.solution(local)
        programs.append(program)
        assert program.problem.is_dcp(dpp=True)
        assert found.slack >= SLACK
        assert np.linalg.eigvalsh(found.bound)[0] > 0.0
    assert all(program is programs[0] for program in programs)


def test_two_solvers_find_the_same_gains(known):
    pytest.importorskip("scs")
    for local in (known[1], known[8]):
        one, other = (design("nominal", solver=name).solution(local) for name in ("CLARABEL", "SCS"))
        np.testing.assert_allclose(one.gains, other.gains, atol=1e-5)
        assert one.cost == pytest.approx(other.cost, rel=1e-6)
        assert np.abs(one.gains).max() > 1e-3


@pytest.mark.parametrize("variant", ["moment", "sector"])
def test_with_the_papers_numbers_the_guaranteed_gains_are_none_at_all(known, variant):
    """Derivation, D5.6: shares may be one, and then the innovation does not depend on the state."""
    for local in (known[0], known[7]):
        apart = local.differences.copy()
        apart[:, 2] = 0.0
        found = design(variant).solution(local._replace(differences=apart))
        assert np.abs(found.gains).max() < 1e-8


def test_without_gains_and_remainders_the_program_finds_the_smallest_sum_of_ellipsoids(known):
    local = known[4]._replace(remainder=0.0)
    units = scaled(local, Q).units
    lmi = Lmi(PAPER, Q, variant="sector", members=3, weights=np.ones(3))
    expected = dead_reckoning_bound(local, Q, 4).bound
    found = lmi.gains(local).bound
    assert np.trace(found) == pytest.approx(np.trace(expected), rel=1e-5)
    np.testing.assert_allclose(found / np.outer(units, units), expected / np.outer(units, units), atol=1e-3)


def test_the_bound_of_the_sector_design_holds_for_the_true_next_error():
    """With gains that are active: errors, noise, shares, values and silence anywhere within their bounds."""
    network = cameras(2, assumed_attack=MILD)
    shares, rng = Shares.of(MILD, 2), np.random.default_rng(3)
    local = locals_of(network, 1, 0.0)[0]
    shape = np.diag([9.0, 9.0, 1e-4])
    wide = local._replace(
        covariances=np.array([shape, shape]),
        differences=np.zeros((2, 3)),
        slack=np.array([0.0, 0.5]),
        remainder=network.plant.remainder_bound(np.zeros(3), shape),
        remainders=np.array(
            [s.remainder_bound(network.nodes[0]._state, shape) for s in network.sensors.values()]
        ),
    )
    guess = np.array([1.5, 0.2, 0.0])
    slopes = np.array([s.jacobian(guess) for s in network.sensors.values()])
    values = np.array([s.measure(guess[None])[0] for s in network.sensors.values()])
    wide = wide._replace(slopes=slopes, values=values, F=network.plant.jacobian(guess))
    wide = wide._replace(
        remainders=np.array([s.remainder_bound(guess, shape) for s in network.sensors.values()])
    )
    gains = design("sector", members=2, shares=shares).gains(wide)
    assert np.abs(gains.matrix).max() > 1e-2
    root, worst = np.linalg.cholesky(shape), 0.0
    for _ in range(4000):
        e, w = (_on_ball(rng, 3) for _ in range(2))
        x = guess + root @ e
        sent = []
        for j, sensor in enumerate(network.sensors.values()):
            xi, value = rng.choice([0.0, 0.3], 2), rng.choice([-1.0, 1.0], 2)
            y = sensor.measure(x[None])[0] + np.sqrt(2.0) * _on_ball(rng, 2)
            innovation = (1.0 - xi) * y + xi * value - values[j]
            sent.append(innovation - np.sqrt(wide.slack[j]) * _on_ball(rng, 2))
        both = np.concatenate((sent[0], sent[1] - sent[0]))
        after = network.plant.transition(x[None])[0] + np.sqrt(3.0 * np.diag(Q)) * w
        error = after - network.plant.transition(guess[None])[0] - gains.matrix @ both
        worst = max(worst, float(error @ np.linalg.solve(gains.bound, error)))
    assert 0.2 < worst <= 1.0


def _on_ball(rng, size):
    """Return a point on the unit sphere, or within it now and then."""
    drawn = rng.standard_normal(size)
    return drawn / np.linalg.norm(drawn) if rng.random() < 0.8 else drawn_within(1.0, size, rng)


def test_a_program_that_is_not_solved_is_counted_and_its_step_has_gains_in_closed_form(known, monkeypatch):
    monkeypatch.setitem(gain_programs._OPTIONS, "CLARABEL", {"max_iter": 1})
    lmi, local = design("nominal"), known[6]
    found = lmi.gains(local)
    expected = Riccati(PAPER, Q).gains(as_moments(local))
    assert lmi.failures == 1
    np.testing.assert_array_equal(found.matrix, expected.matrix)
    np.testing.assert_array_equal(found.bound, 3.0 * expected.bound)
    sector = design("sector")
    found = sector.gains(local)
    assert sector.failures == 1
    assert not found.matrix.any()
    np.testing.assert_array_equal(found.bound, dead_reckoning_bound(local, Q, 4).bound)


def test_failures_stand_in_the_diagnostics(monkeypatch):
    monkeypatch.setitem(gain_programs._OPTIONS, "CLARABEL", {"max_iter": 1})
    network = cameras(2, design=GainDesign(lmi="nominal"))
    drive(network, 3, 5.0)
    diagnostics = network.nodes[0].estimate(2).diagnostics
    assert diagnostics["solver_failures"] == 3.0
    assert diagnostics["bound_guaranteed"] == 0.0


def test_a_neighbour_that_is_not_heard_leaves_the_rest_as_if_it_were_not_there(known):
    """The program is that of three members; two are left."""
    local = known[7]
    fewer = local._replace(
        **{
            name: getattr(local, name)[:2]
            for name in ("values", "slopes", "remainders", "noise", "differences", "covariances", "slack")
        }
    )
    for variant in ("nominal", "moment"):
        one, other = (design(variant, members).gains(fewer) for members in (3, 2))
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-5)
        np.testing.assert_allclose(one.bound, other.bound, rtol=1e-4, atol=1e-7)


def test_a_node_without_measurement_uses_the_others_alone(known):
    for variant in ("nominal", "sector"):
        gains = design(variant).gains(known[7]._replace(measured=False))
        assert np.isfinite(gains.matrix).all()
        assert np.abs(gains.matrix[:, :2]).max() < 1e-5


def test_gains_depend_on_the_step_alone_and_not_on_what_was_solved_before(known):
    one, other = design("nominal"), design("nominal")
    first = one.gains(known[2])
    other.gains(known[9])
    again = other.gains(known[2])
    np.testing.assert_array_equal(first.matrix, again.matrix)
    np.testing.assert_array_equal(first.bound, again.bound)


def test_without_the_extra_the_message_says_what_to_install_before_anything_runs(monkeypatch):
    monkeypatch.setattr(gain_programs, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"needs cvxpy and clarabel: pip install -e '\.\[lmi\]' in"):
        cameras(2, design=GainDesign(lmi="nominal"))
    with pytest.raises(TopologyError) as caught:
        load_topology(FOLDER / "lmi.yaml")
    assert "pip install -e '.[lmi]' in a checkout" in str(caught.value)
    assert "sends to no neighbour" not in str(caught.value)
