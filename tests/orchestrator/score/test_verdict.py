"""The verdict for people: one sentence that is true, and a page that fits."""

from __future__ import annotations

import io
import re
from itertools import takewhile

import pytest
from rich.console import Console

from orchestrator.score.expectation import Expectation
from orchestrator.score.headline import headline
from orchestrator.score.results import ScoreOptions
from orchestrator.score.scoring import score
from orchestrator.score.verdict import print_verdict

GROUPS = {"position": [0], "velocity": [1], "acceleration": [2]}
EXPECTATIONS = [
    Expectation("divergences", equals=0),
    Expectation("rmse.position", nodes=("e4", "e12"), at_most=0.6),
]


def scored(run, expectations=EXPECTATIONS):
    return score(run.plan(), run.records(), state_groups=GROUPS, expectations=expectations)


def page(result, width, encoding="utf-8"):
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding)
    console = Console(file=stream, width=width)
    print_verdict(
        result, console, timing={"steps_per_s": 141.2, "startup_s": 0.43}, files={"Log": "runs/one/run.mcap"}
    )
    stream.flush()
    return raw.getvalue().decode(encoding)


def test_a_network_that_held_is_said_to_have_kept_tracking(make_network):
    assert headline(scored(make_network())) == (
        "PASSED: the network kept tracking through the attack on s4->e4 and s12->e12; "
        "all 2 expectations held."
    )


@pytest.mark.parametrize(
    ("names", "subject"),
    [
        (("e1", "e2", "e3", "e4"), "the estimators e1..e4, each alone,"),
        (("e1", "e2"), "the estimators e1 and e2, each alone,"),
        (("e1", "e3", "e4"), "the estimators e1, e3 and e4, each alone,"),
        (("bold", "shy", "wise", "odd"), "all 4 estimators, each alone,"),
        (("e9", "e10", "e11", "e12"), "the estimators e9..e12, each alone,"),
    ],
)
def test_estimators_that_exchange_nothing_are_called_no_network(make_plan, recorder, names, subject):
    for step in range(10):
        recorder.truth(step, [0.0])
        for name in names:
            recorder.inbox(name, step, [("s1", step)])
            recorder.estimate(name, step, [1.0])
        recorder.channel(step, events=[])
    alone = score(make_plan(10, {name: ["s1"] for name in names}), recorder.records, state_groups={})
    assert len(alone.networks) == 1, "they are compared with one another all the same"
    assert headline(alone) == f"DONE: {subject} kept tracking; nothing was expected of it."
    ring = {name: [names[i - 1]] for i, name in enumerate(names)}
    plan = make_plan(10, {name: ["s1"] for name in names}, ring)
    assert headline(score(plan, recorder.records, state_groups={})).startswith("DONE: the network kept")


def test_a_failure_names_the_metric_and_what_became_of_the_estimators(make_network):
    result = scored(make_network(deaf=["e4"], diverging={"e7": 31}))
    assert headline(result) == (
        "FAILED: 1 of 2 expectations failed (divergences); 1 of 20 estimators diverged (e7 at step 31) and "
        "1 detector locked out for good (e4 to s4)."
    )


def test_a_run_without_expectations_is_done(make_network):
    result = scored(make_network(nodes=1, attacked={}), [])
    assert headline(result) == "DONE: the estimator e1 kept tracking; nothing was expected of it."


def test_a_record_cut_off_before_the_first_scored_step_is_no_tracking(make_network):
    run = make_network()
    records = [record for record in run.records() if record[1].step < 5]
    result = score(run.plan(), records, state_groups=GROUPS, options=ScoreOptions(from_step=10))
    assert headline(result).endswith("as far as they go, no estimate was scored.")


def test_only_estimators_that_are_there_to_the_end_are_said_to_track(make_plan, recorder):
    for step in range(10):
        recorder.truth(step, [0.0])
        for name in ("e1", "e2", "e3"):
            if name == "e3" and step >= 4:
                continue
            recorder.inbox(name, step, [("s1", step)])
            recorder.estimate(name, step, [1.0])
        recorder.channel(step, events=[])
    plan = make_plan(10, {name: ["s1"] for name in ("e1", "e2", "e3")}, {"e1": ["e2"], "e2": ["e1"]})
    result = score(plan, recorder.records, state_groups={}, departed={"e3": 4})
    assert headline(result).startswith("DONE: all 2 other estimators kept tracking, though the run lost e3")


def test_an_incomplete_record_is_said_to_be_so(make_network):
    run = make_network()
    records = [record for record in run.records() if record[1].step < 149]
    result = score(run.plan(), records, state_groups=GROUPS, expectations=EXPECTATIONS)
    assert headline(result).startswith(
        "INCOMPLETE: 149 of 150 steps recorded, 20 estimates missing; as far as they go, "
    )


def test_an_attacked_estimator_far_off_the_usual_is_not_said_to_keep_tracking(make_plan, recorder):
    for step in range(10):
        attacked = step == 5
        recorder.truth(step, [0.0])
        recorder.inbox("e1", step, [("s1", step)])
        recorder.channel(step, events=[("s1->e1", "bias", step, "attacked")] if attacked else [])
        recorder.estimate("e1", step, [7.0 if attacked else 1.0])
    result = score(make_plan(10, {"e1": ["s1"]}), recorder.records, state_groups={})
    assert headline(result) == (
        "DONE: no estimator diverged through the attack on s1->e1, but e1 erred 7 times the usual; "
        "nothing was expected of it."
    )


def test_an_estimator_far_off_what_it_believes_is_not_said_to_keep_tracking(make_plan, recorder):
    """With every step under attack there is no usual error; its own covariance still tells."""
    for step in range(10):
        recorder.truth(step, [0.0])
        recorder.inbox("e1", step, [("s1", step)])
        recorder.channel(step, events=[("s1->e1", "bias", step, "attacked")])
        recorder.estimate("e1", step, [9.0], [9.0])
    result = score(make_plan(10, {"e1": ["s1"]}), recorder.records, state_groups={})
    assert headline(result).startswith(
        "DONE: no estimator diverged through the attack on s1->e1, but e1 erred 3 times what it believed"
    )


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"deaf": ["e4"], "diverging": {"e7": 31}},
        {"attacked": {f"e{i}": (20 + i, 60) for i in range(1, 15)}},
    ],
)
def test_the_page_fits_and_is_plain_text_without_a_terminal(make_network, width, settings):
    text = page(scored(make_network(**settings), EXPECTATIONS * 12), width)
    lines = text.splitlines()
    assert len(lines) <= 45
    assert max(map(len, lines)) <= width
    assert "\x1b" not in text
    assert "…" not in text


@pytest.mark.parametrize("width", [40, 60, 80])
def test_on_a_narrow_terminal_every_figure_of_an_estimator_is_whole(make_network, width):
    result = scored(make_network(diverging={"e7": 31}))
    text, wide = page(result, width), page(result, 200)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    for name in ("e4", "e12"):
        row, whole = (re.search(rf"^  {name} .*$", own, re.MULTILINE)[0].split() for own in (text, wide))
        kept = list(takewhile(re.compile(r"[-+.\de]+").fullmatch, row[1:]))
        assert len(kept) >= 2
        assert kept == whole[1 : 1 + len(kept)]
    assert ("no room for" in text) is (width == 40)
    assert " ".join(text.split()).count("attacked 6 steps") == wide.count("attacked 6 steps")


def test_the_page_shows_attacked_estimators_expectations_and_files(make_network):
    text = page(scored(make_network(diverging={"e7": 31})), 120)
    for part in (
        "SecureDistributedFilter (20)",
        "worst, diverged at 31",
        "attacked 6 steps",
        "✗ divergences exactly 0: 1",
        "✓ rmse.position at most 0.6",
        "141 steps/s, startup 0.43 s",
        "Log: runs/one/run.mcap",
    ):
        assert part in text
    assert "e12" in text


def test_failed_expectations_are_shown_first_when_there_are_many(make_network):
    expectations = [Expectation("packets.sent", at_least=0)] * 30 + [Expectation("packets.sent", equals=1)]
    text = page(scored(make_network(), expectations), 80)
    assert "✗ packets.sent exactly 1: 9000" in text
    assert "and 23 more, of which 0 failed" in text


def test_a_console_without_unicode_gets_words(make_network):
    text = page(scored(make_network(diverging={"e7": 31})), 80, encoding="ascii")
    assert "NO divergences exactly 0: 1" in text


def test_verdicts_that_name_no_packet_that_came_are_told_even_when_no_other_was_given(make_plan, recorder):
    for step in range(3):
        recorder.truth(step, [0.0])
        recorder.inbox("e1", step, [("s1", step)])
        recorder.estimate("e1", step, [0.0], verdicts=[("s9", step, False)])
        recorder.channel(step, events=[])
    result = score(make_plan(3, {"e1": ["s1"]}), recorder.records, state_groups={})
    assert result.detector is None
    assert "Detectors: 3 verdicts on packets that never came." in page(result, 100)
