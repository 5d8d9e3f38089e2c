"""Properties of the whole score."""

from __future__ import annotations

import itertools
import json
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus.messages import decoder, encode, message_type
from orchestrator.score.results import Score, ScoreOptions
from orchestrator.score.scoring import score

GROUPS = {"position": [0], "velocity": [1], "acceleration": [2]}


@pytest.fixture(scope="module")
def run(make_network):
    return make_network(steps=40, nodes=5, attacked={"e2": (10, 15), "e4": (20, 39)}, deaf=["e2"])


@given(seed=st.integers(0, 2**32))
@settings(max_examples=10, deadline=None)
def test_the_order_of_messages_inside_a_step_does_not_matter(run, seed):
    def by_step(record):
        return record[1].step

    records = list(run.records())
    shuffled = []
    for _, messages in itertools.groupby(sorted(records, key=by_step), key=by_step):
        step = list(messages)
        random.Random(seed).shuffle(step)
        shuffled += step
    options = ScoreOptions(node_series=True)
    once, again = (
        score(run.plan(), one, state_groups=GROUPS, options=options).to_json() for one in (records, shuffled)
    )
    assert once == again


def test_a_record_scores_alike_from_memory_and_from_its_encoding(run):
    decoded = [
        (topic, decoder(message_type(topic)).decode(encode(message))) for topic, message in run.records()
    ]
    from_memory = score(run.plan(), run.records(), state_groups=GROUPS)
    assert score(run.plan(), decoded, state_groups=GROUPS).to_json() == from_memory.to_json()


@given(
    states=st.lists(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=2), min_size=1, max_size=20),
    lag=st.integers(-2, 2),
)
@settings(max_examples=30, deadline=None)
def test_a_perfect_estimator_has_no_error(make_plan, make_recorder, states, lag):
    recorder = make_recorder()
    steps = len(states)
    for step, state in enumerate(states):
        recorder.truth(step, state)
        refers_to = min(max(step + lag, 0), steps - 1)
        recorder.estimate("e1", step, states[refers_to], [1.0, 0.0, 0.0, 1.0], refers_to=refers_to)
    result = score(make_plan(steps, {"e1": ["s1"]}), recorder.records, state_groups={"position": [0]})
    node = result.nodes[0]
    assert [error.rmse for error in node.groups.values()] == [0.0, 0.0]
    assert node.nees.mean == 0.0
    assert result.complete


@given(
    fates=st.lists(st.tuples(st.sampled_from(["lost", "genuine", "attacked"]), st.booleans()), max_size=40),
    copies=st.integers(1, 3),
)
@settings(max_examples=50, deadline=None)
def test_the_confusion_counts_every_delivery_once(make_plan, make_recorder, fates, copies):
    recorder = make_recorder()
    steps = max(len(fates), 1)
    for step in range(steps):
        recorder.truth(step, [0.0])
    for step, (fate, alarm) in enumerate(fates):
        arrived = [] if fate == "lost" else [("s1", step)] * copies
        recorder.inbox("e1", step, arrived)
        recorder.channel(step, events=[("s1->e1", "bias", step, "attacked")] if fate == "attacked" else [])
        recorder.estimate("e1", step, [0.0], verdicts=[(*packet, alarm) for packet in arrived])
    confusion = score(make_plan(steps, {"e1": ["s1"]}), recorder.records, state_groups={}).detector
    delivered = [(fate, alarm) for fate, alarm in fates if fate != "lost"]
    if not delivered:
        assert confusion is None
        return
    assert confusion.true_positive == copies * delivered.count(("attacked", True))
    assert confusion.false_positive == copies * delivered.count(("genuine", True))
    assert confusion.false_negative == copies * delivered.count(("attacked", False))
    assert confusion.true_negative == copies * delivered.count(("genuine", False))


def test_the_json_is_canonical_and_reads_back(run):
    result = score(run.plan(), run.records(), state_groups=GROUPS, options=ScoreOptions(node_series=True))
    text = result.to_json()
    assert Score.from_json(text) == result
    assert Score.from_json(text).to_json() == text
    plain = json.loads(text, parse_constant=pytest.fail)
    assert text == score(run.plan(), run.records(), state_groups=GROUPS, options=result.options).to_json()

    def keys_sorted(value):
        if isinstance(value, dict):
            return list(value) == sorted(value) and all(map(keys_sorted, value.values()))
        return not isinstance(value, list) or all(map(keys_sorted, value))

    assert keys_sorted(plain)


def test_node_series_are_the_error_norms_step_by_step(run):
    result = score(run.plan(), run.records(), state_groups=GROUPS, options=ScoreOptions(node_series=True))
    node = result.nodes[0]
    assert np.sqrt(np.mean(np.square(node.error["position"]))) == pytest.approx(node.groups["position"].rmse)
    assert score(run.plan(), run.records(), state_groups=GROUPS).nodes[0].error == {}


def test_a_network_under_attack_is_told_as_it_was_made(run):
    result = score(run.plan(), run.records(), state_groups=GROUPS)
    assert [node.attacked_steps for node in result.nodes] == [0, 6, 0, 20, 0]
    assert [(window.link, window.first, window.last) for window in result.windows] == [
        ("s2->e2", 10, 15),
        ("s4->e4", 20, 39),
    ]
    assert [(lockout.node, lockout.first_step) for lockout in result.lockouts] == [("e2", 16)]
    assert result.traffic.sent == 40 * (5 + 10)
    assert result.traffic.attacked == 26
    assert result.complete


@pytest.mark.parametrize(
    "options",
    [
        {"from_step": -1},
        {"lockout_length": 0},
        {"divergence_bound": 0.0},
        {"confidence": 1.0},
        {"detection_grace": -1},
    ],
)
def test_options_without_meaning_are_refused(options):
    with pytest.raises(ValueError, match="must be"):
        ScoreOptions(**options)
