"""What Forti 2019, section VI shows, and what it does not: whole runs of its topology files.

The quick figures come from few trials and have wide ranges; ``-m slow`` takes 100 trials. ``-s`` prints them.
All draws are seeded: on one type of machine a test passes always or never.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from bus.messages import ChannelEvents, Estimate, Message, Truth
from orchestrator.backends.inprocess import run_messages
from orchestrator.evidence.calibration import calibration
from orchestrator.topology.load import load_topology
from orchestrator.topology.problems import TopologyError
from tests.papers.campaigns import quick_or_full
from tests.playing import assert_keeps_what_it_expects, scored

FOLDER = Path(__file__).parents[2] / "topologies" / "forti2019"
FILES = [path.stem for path in sorted(FOLDER.glob("*.yaml")) if not path.stem.startswith("_")]
QUICK, FULL = 3, 100
ONSET, RELEASE = 150, 350
SETTLED = 10
IN_ATTACK = np.array([0.211, 0.088, 0.015, 0.020, 0.010])
OUTSIDE = np.array([0.050, 0.022])
SIGNAL = np.array([0.101, 0.228])
"""Errors in the steady state without loss, by the Riccati equation."""
NO_BASELINES = tuple(f"estimators.e{i}=null" for i in (3, 4, 5, 6))

pytestmark = pytest.mark.timeout(600)

trials = quick_or_full(QUICK, FULL)


@dataclass(frozen=True)
class Run:
    """One trial: by estimator the errors (K, n) and the diagnostics of each step, and what happened."""

    error: dict[str, np.ndarray]
    diagnostics: dict[str, dict[str, np.ndarray]]
    attack: np.ndarray
    """(K, q): the signal of each step."""
    genuine: np.ndarray
    """(K,): whether the genuine packet reached the estimators."""

    @property
    def clean(self) -> np.ndarray:
        """Steps with genuine packets now and in the two steps before."""
        found: np.ndarray = self.genuine & np.roll(self.genuine, 1) & np.roll(self.genuine, 2)
        return found

    def r(self, node: str = "e1") -> np.ndarray:
        return self.diagnostics[node]["attack_probability"]

    def signal_error(self, node: str = "e1") -> np.ndarray:
        own = self.diagnostics[node]
        return np.stack((own["a0"], own["a1"]), axis=1) - self.attack


def carry_out(name: str, trial: int, overrides: Sequence[str] = ()) -> Run:
    topology = load_topology(FOLDER / f"{name}.yaml", [*overrides, "expect=null"]).at(trial=trial)
    estimates: dict[str, list[Estimate]] = {}
    truth: list[Truth] = []
    spoilt: set[int] = set()

    def keep(topic: str, message: Message) -> None:
        if isinstance(message, Truth):
            truth.append(message)
        elif isinstance(message, Estimate):
            estimates.setdefault(topic.partition("/")[2], []).append(message)
        elif isinstance(message, ChannelEvents):
            acts = zip(message.event_link, message.event_action, strict=True)
            if any(link == "s1->e1" and act in ("lost", "attacked") for link, act in acts):
                spoilt.add(message.step)

    run_messages(topology.plan, keep)
    states = np.array([one.state for one in truth])
    return Run(
        {node: np.array([one.state for one in own]) - states for node, own in estimates.items()},
        {
            node: {
                name: np.array([one.diagnostic_value[i] for one in own])
                for i, name in enumerate(own[0].diagnostic_name)
            }
            for node, own in estimates.items()
        },
        np.array([one.attack for one in truth]),
        np.array([step not in spoilt for step in range(len(states))]),
    )


Campaigns = Callable[..., list[Run]]


@pytest.fixture(scope="module")
def campaign() -> Campaigns:
    """Return a call that runs trials of a file; what it ran is kept for the module."""
    known: dict[tuple[str, ...], list[Run]] = {}

    def run(name: str, trials: int, *overrides: str) -> list[Run]:
        runs = known.setdefault((name, *overrides), [])
        runs += [carry_out(name, trial, overrides) for trial in range(len(runs), trials)]
        return runs[:trials]

    return run


def rms(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Return the root mean square over all rows of some arrays."""
    found: np.ndarray = np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0))
    return found


def window(run: Run, attacked: bool) -> np.ndarray:
    """Return the steps in which the attack is on, or off, without the first ones and those of a change."""
    step = np.arange(len(run.genuine))
    on = (step >= ONSET + 10) & (step < RELEASE)
    off = ((step >= SETTLED) & (step < ONSET)) | (step >= RELEASE + 10)
    return on if attacked else off


@pytest.mark.parametrize("name", FILES)
def test_the_file_holds_what_it_expects(name: str) -> None:
    assert_keeps_what_it_expects(scored(load_topology(FOLDER / f"{name}.yaml")))


def test_a_signal_of_another_size_than_the_swinging_network_takes_is_refused() -> None:
    file = FOLDER / "ieee14_large_swings.yaml"
    with pytest.raises(TopologyError, match="a signal of 1 components for a plant that takes 2"):
        load_topology(file, ["attacks[0].signal.value=[0.2]"])


@trials
def test_an_attack_is_found_and_its_end_is_seen_with_the_first_packet_that_arrives(
    campaign: Campaigns, trials: int
) -> None:
    for run in campaign("injection", trials, *NO_BASELINES):
        step = np.arange(len(run.genuine))
        attacked = (step >= ONSET) & (step < RELEASE)
        for node in ("e1", "e2"):
            np.testing.assert_array_equal((run.r(node) > 0.5)[run.genuine], attacked[run.genuine])


@trials
def test_where_no_packet_is_lost_the_errors_are_those_of_the_riccati_equation(
    campaign: Campaigns, trials: int
) -> None:
    runs = campaign("injection", trials, *NO_BASELINES)
    on = rms([run.error["e1"][window(run, True) & run.clean] for run in runs])
    off = rms([run.error["e1"][window(run, False) & run.clean] for run in runs])
    signal = rms([run.signal_error()[window(run, True) & run.clean] for run in runs])
    print("\nclean steps, in attack", on.round(4), "outside", off.round(4), "signal", signal.round(4))
    tolerance = {QUICK: 0.12, FULL: 0.06}[trials]
    np.testing.assert_allclose(on / IN_ATTACK, 1.0, atol=tolerance)
    np.testing.assert_allclose(off[:2] / OUTSIDE, 1.0, atol=tolerance)
    np.testing.assert_allclose(signal / SIGNAL, 1.0, atol=tolerance)


@trials
def test_twenty_fakes_a_step_cost_nothing_and_the_mixtures_stay_at_one_component(
    campaign: Campaigns, trials: int
) -> None:
    """The same measurements and losses meet both, so that the ratio hardly depends on the draws."""
    none = campaign("injection", trials, *NO_BASELINES, "attacks[2].injection.count=0")
    many = campaign("injection", trials, *NO_BASELINES, "attacks[2].injection.count.poisson=20")
    for attacked in (False, True):
        errors = [rms([run.error["e1"][window(run, attacked)] for run in runs]) for runs in (many, none)]
        print("\n20 fakes over none, attacked", attacked, (errors[0] / errors[1]).round(4))
        np.testing.assert_allclose(errors[0] / errors[1], 1.0, atol=0.05)
    for count in ("components", "components_attacked"):
        components = np.mean([run.diagnostics["e1"][count] for run in many])
        print(count, components)
        assert components <= 1.1


@trials
def test_while_packets_are_missing_the_attack_probability_follows_the_chain_alone(
    campaign: Campaigns, trials: int
) -> None:
    sequences: dict[tuple[bool, int], list[float]] = {}
    for run in campaign("injection", trials, *NO_BASELINES):
        missing = 0
        for step in range(SETTLED, len(run.genuine)):
            missing = 0 if run.genuine[step] else missing + 1
            attacked = ONSET <= step < RELEASE
            if missing and ONSET <= step - missing < RELEASE == attacked:
                continue
            if missing and (ONSET <= step - missing < RELEASE) == attacked:
                sequences.setdefault((attacked, missing), []).append(run.r()[step])
    for (attacked, missing), found in sequences.items():
        expected = (0.8, 0.68, 0.608)[missing - 1] if attacked else (0.2, 0.32, 0.392)[missing - 1]
        np.testing.assert_allclose(found, expected, atol=1e-3)
    assert {(False, 1), (True, 1)} <= set(sequences)


@trials
def test_the_update_as_printed_is_three_times_worse_in_x1_and_owes_it_to_the_prior_that_is_far_off(
    campaign: Campaigns, trials: int
) -> None:
    ranges = {QUICK: ((1.8, 5.0), (0.8, 1.25)), FULL: ((2.5, 3.7), (0.9, 1.1))}[trials]
    better = [f"estimators.e{i}.attack_prior[0].mean=[15.1,14.47]" for i in (1, 2)]
    for overrides, (low, high) in zip(((), better), ranges, strict=True):
        runs = campaign("injection", trials, *NO_BASELINES, *overrides)
        errors = {
            node: rms([run.error[node][window(run, True)] for run in runs])[:2].round(3)
            for node in ("e1", "e2")
        }
        signal = {node: rms([run.signal_error(node)[window(run, True)] for run in runs]) for node in errors}
        print(f"\nin attack {errors}, signal {signal}")
        assert low <= errors["e2"][0] / errors["e1"][0] <= high


@pytest.mark.parametrize(
    ("trials", "most"),
    [(8, 0.03), pytest.param(FULL, 0.02, marks=[pytest.mark.slow, pytest.mark.timeout(3600)])],
)
def test_on_data_of_its_own_model_the_attack_probability_is_a_probability(
    campaign: Campaigns, trials: int, most: float
) -> None:
    runs = campaign("calibration", trials)
    r = np.concatenate([run.r() for run in runs])
    happened = np.concatenate([run.attack.any(axis=1) for run in runs])
    found = calibration(r, happened, np.repeat(np.arange(trials), len(runs[0].attack)))
    wrong = float(np.mean((r > 0.5) != happened))
    print(f"\ncalibration error {found.error}, {found.by_chance:.4f} by chance alone")
    print(f"wrong {wrong:.3f}, unsure {np.mean(abs(r - 0.5) < 0.4):.2f}")
    assert found.error.value <= most
    assert found.error.low == 0.0
    assert 0.05 < wrong < 0.4


@pytest.mark.parametrize(("name", "settled"), [("sweep_wide", SETTLED), ("ieee14_sweep", 2)])
@trials
def test_what_it_believes_of_wide_fakes_does_not_matter(
    campaign: Campaigns, trials: int, name: str, settled: int
) -> None:
    runs = campaign(name, min(trials, 20))
    nodes = [f"e{i}" for i in range(1, 8)]
    errors = np.array([rms([run.error[node][settled:] for run in runs]) for node in nodes])
    signal = np.array(
        [rms([run.signal_error(node)[run.attack.any(axis=1)] for run in runs]) for node in nodes]
    )
    print(f"\nwide fakes, {name}: first state", errors[:, 0].round(4), "signal", signal[:, 0].round(4))
    np.testing.assert_allclose(errors / errors[4], 1.0, atol=0.01)
    np.testing.assert_allclose(signal / signal[4], 1.0, atol=0.01)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_with_fakes_among_the_measurements_the_errors_are_least_where_it_believes_the_truth(
    campaign: Campaigns,
) -> None:
    """From step 40 on: beside the wide prior of the state the first packets look like fakes."""
    runs = campaign("sweep_near", FULL)
    late = window(runs[0], False) & (np.arange(len(runs[0].genuine)) >= 40)
    errors = np.array([rms([run.error[f"e{i}"][late] for run in runs])[0] for i in range(1, 8)])
    print("\nnear fakes: x1 outside the attack", errors.round(4))
    assert int(errors.argmin()) in (3, 4)
    assert 1.03 <= errors[0] / errors[4] <= 1.12


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_on_the_network_too_the_errors_among_near_fakes_are_least_at_the_truth_and_differ_little(
    campaign: Campaigns,
) -> None:
    """As in the paper's Fig 12: all states, in attack and outside."""
    runs = campaign("ieee14_sweep_near", FULL)
    nodes = [f"e{i}" for i in range(1, 8)]
    errors = np.array([np.sqrt(np.mean([run.error[node][2:] ** 2 for run in runs])) for node in nodes])
    print("\nnear fakes: states of the network", errors.round(4))
    assert int(errors.argmin()) in (3, 4)
    assert 1.005 <= errors[0] / errors[4] <= 1.05
    assert errors[6] > 1.003 * errors[4]


@trials
def test_altered_loads_are_found_at_once_and_angles_frequencies_and_loads_are_tracked(
    campaign: Campaigns, trials: int
) -> None:
    runs = campaign("ieee14_injection", 4 * trials)
    before, after = (
        np.mean([run.r()[steps].mean() for run in runs]) for steps in (slice(2, 50), slice(52, 100))
    )
    late = np.array([run.r()[50:] > 0.5 for run in runs]).argmax(axis=1)
    each = rms([run.error["e1"][2:] for run in runs])
    signal = rms([run.signal_error()[52:] for run in runs])
    print(f"\nr {before:.3f} before, {after:.3f} after; delay {late.mean():.2f}, {late.max()} at most")
    print("angles and frequencies", each.round(3), "loads", signal.round(3))
    assert before < 0.15 < 0.75 < after
    assert late.mean() < {QUICK: 2.0, FULL: 1.5}[trials]
    assert np.all(each < 0.12)
    assert np.all(signal < 0.14)


@trials
def test_without_feedthrough_an_attack_is_found_one_step_later_whenever_the_packet_arrives(
    campaign: Campaigns, trials: int
) -> None:
    """Found in every run; before the onset, noise may look like an attack once in a thousand steps."""
    false_alarms = steps = 0
    for run in campaign("ieee14_no_feedthrough", 4 * trials):
        attacked = np.arange(1, 101) > 50
        found, expected = (run.r() > 0.5)[1:][run.genuine[1:]], attacked[:-1][run.genuine[1:]]
        assert np.all(found[expected])
        false_alarms += int(found[~expected].sum())
        steps += int((~expected).sum())
        assert np.all(run.diagnostics["e1"]["attack_step"] == np.arange(-1, 99))
    print(f"\n{false_alarms} false alarms in {steps} steps before the onset")
    assert false_alarms <= 1e-3 * steps


@trials
def test_substituted_packets_of_the_power_network_cost_what_lost_ones_do(
    campaign: Campaigns, trials: int
) -> None:
    runs = campaign("ieee14_substitution", 4 * trials)
    good = rms([run.error["e1"][2:][run.genuine[2:]] for run in runs])
    bad = rms([run.error["e1"][2:][~run.genuine[2:]] for run in runs])
    print("\nwith the genuine packet", good.round(3), "with a fake", bad.round(3))
    assert np.all(good < 0.12)
    assert np.all(bad > 1.2 * good)


def test_packets_of_several_sensors_are_worth_more_than_all_or_nothing(campaign: Campaigns) -> None:
    """The measurement comes in parts that are lost on their own: x3 to x5 are as good as without loss."""
    runs = campaign("several_sensors", QUICK)
    errors = rms([run.error["e1"][window(run, False)] for run in runs])
    print("\nseveral sensors, outside the attack", errors.round(4))
    np.testing.assert_allclose(errors[2:] / IN_ATTACK[2:], 1.0, atol=0.25)
