"""The recovered attack: against plain numpy on the record, and where nothing can be said."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from bus.messages import Estimate, Inbox, Message, Transmission
from orchestrator.backends.inprocess import run_messages
from orchestrator.score.link_results import RecoveredAttack
from orchestrator.score.results import Score
from orchestrator.score.scoring import score
from orchestrator.topology.load import Topology, load_topology

TEXT = """\
period_s: 1.0
steps: 120
plant: {model: quadruple_tank}
sensors:
  s1: {model: linear, C: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], noise: {std: 0.03}}
estimators:
  told: {method: particle_fdi, sensors: [s1], particles: 50, minimum_attack: 0.28, attack_estimate: oracle}
  inexact:
    {method: particle_fdi, sensors: [s1], particles: 50, minimum_attack: 0.28, attack_estimate: noisy_oracle}
  tracking: {method: particle_fdi, sensors: [s1], particles: 50, minimum_attack: 0.28}
  plain: {method: particle, sensors: [s1], particles: 50}
channel: {s1->*: [CHANNEL]}
attacks:
  - {converging_bias: {target: 0.5}, on: "s1->*", stream: s1, name: bias}
oracles: {told: bias, inexact: bias}
"""

Records = list[tuple[str, Message]]


def played(folder: Path, channel: str = "", more: str = "") -> tuple[Topology, Records]:
    path = folder / "topology.yaml"
    path.write_text(TEXT.replace("CHANNEL", channel) + more)
    topology, messages = load_topology(path), Records()
    run_messages(topology.plan, lambda topic, message: messages.append((topic, message)))
    return topology, messages


def scored(topology: Topology, messages: Records) -> Score:
    return score(topology.plan, messages, state_groups=topology.state_groups, options=topology.score_options)


def found(topology: Topology, messages: Records) -> dict[str, RecoveredAttack | None]:
    return {link.destination: link.recovered for link in scored(topology, messages).links}


def by_hand(messages: Records, node: str) -> tuple[int, float, float]:
    """Return the attacked packets of a run without loss, the error's RMS norm, and its NEES by component."""
    sent = {m.step: np.array(m.values) for t, m in messages if t.startswith("tx/s1") and _is(m, Transmission)}
    came = {
        m.step: np.array(m.values[:4]) for t, m in messages if t == f"rx/{node}/correct" and _is(m, Inbox)
    }
    errors, figures = [], []
    for topic, message in messages:
        if topic != f"estimate/{node}" or not isinstance(message, Estimate):
            continue
        added = came[message.step] - sent[message.step]
        if not added.any():
            continue
        said = dict(zip(message.diagnostic_name, message.diagnostic_value, strict=True))
        error = np.array([said[f"attack_s1_{i}"] for i in range(4)]) - added
        errors.append(error @ error)
        figures.append(
            np.mean([error[i] ** 2 / (said[f"attack_variance_s1_{i}"] or np.inf) for i in range(4)])
        )
    return len(errors), float(np.sqrt(np.mean(errors))), float(np.mean(figures))


def _is(message: Message, kind: type[Message]) -> bool:
    return isinstance(message, kind)


def test_it_is_what_plain_numpy_finds_in_the_record(tmp_path: Path) -> None:
    topology, messages = played(tmp_path)
    result = found(topology, messages)
    assert result["plain"] is None
    for node in ("inexact", "tracking"):
        recovered = result[node]
        assert recovered is not None
        packets, rmse, nees = by_hand(messages, node)
        assert recovered.packets == packets > 40
        assert recovered.rmse == pytest.approx(rmse, rel=1e-12)
        assert recovered.nees_ratio == pytest.approx(nees, rel=1e-12)


def test_an_exact_word_errs_by_nothing_and_one_with_noise_as_much_as_it_says(tmp_path: Path) -> None:
    """Noise of 0.1 in four components has a norm of 0.2; the bounds are six deviations of 160 draws."""
    result = found(*played(tmp_path))
    told, inexact = result["told"], result["inexact"]
    assert told is not None
    assert inexact is not None
    assert told.rmse < 1e-12
    assert told.nees_ratio is None
    assert 0.13 < inexact.rmse < 0.27
    assert 0.4 < (inexact.nees_ratio or 0.0) < 1.7


def test_the_order_of_the_messages_changes_nothing(tmp_path: Path) -> None:
    topology, messages = played(tmp_path)
    shuffled = messages.copy()
    random.Random(0).shuffle(shuffled)
    shuffled.sort(key=lambda record: record[1].step)
    assert scored(topology, shuffled).to_json() == scored(topology, messages).to_json()


def test_lost_late_and_refused_packets_are_left_out(tmp_path: Path) -> None:
    whole = found(*played(tmp_path))["tracking"]
    lossy = found(*played(tmp_path, "{bernoulli: {loss: 0.5, stream: s1}}"))["tracking"]
    late = found(*played(tmp_path, "{delay: {delay: 1}}"))["tracking"]
    sealed = found(*played(tmp_path, more="integrity: {s1: mac}\n"))["tracking"]
    assert whole is not None
    assert lossy is not None
    assert 0.3 * whole.packets < lossy.packets < 0.7 * whole.packets
    assert late is None
    assert sealed is None


def test_it_can_be_expected(tmp_path: Path) -> None:
    more = (
        "expect:\n  recovered.rmse: [{link: s1->told, at_most: 1.0e-9}, {link: s1->inexact, at_least: 0.1}]\n"
        "  recovered.nees_ratio: {node: inexact, at_most: 2}\n"
    )
    topology, messages = played(tmp_path, more=more)
    result = score(
        topology.plan, messages, state_groups=topology.state_groups, expectations=topology.expectations
    )
    assert [outcome.passed for outcome in result.expectations] == [True] * 3
