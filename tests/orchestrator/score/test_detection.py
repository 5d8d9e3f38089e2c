"""Detectors against the channel's truth, on records whose answers are known."""

from __future__ import annotations

import msgspec
import pytest

from orchestrator.score.link_results import AttackWindow
from orchestrator.score.results import ScoreOptions
from orchestrator.score.scoring import score

LINK = "s1->e1"


def play(recorder, steps, attacked, alarms, *, missing=()):
    """Record a link with one packet a step: in which steps it was attacked, lost, and raised the alarm."""
    for step in range(steps):
        recorder.truth(step, [0.0])
        arrived = [] if step in missing else [("s1", step)]
        recorder.inbox("e1", step, arrived)
        recorder.channel(step, events=[(LINK, "bias", step, "attacked")] if step in attacked else [])
        recorder.estimate("e1", step, [0.0], verdicts=[(*packet, step in alarms) for packet in arrived])


def scored(make_plan, recorder, steps, **options):
    return score(
        make_plan(steps, {"e1": ["s1"]}), recorder.records, state_groups={}, options=ScoreOptions(**options)
    )


def counts(confusion):
    return (
        confusion.true_positive,
        confusion.false_positive,
        confusion.false_negative,
        confusion.true_negative,
    )


def test_verdicts_are_counted_against_the_channels_truth(make_plan, recorder):
    play(recorder, 8, attacked={2, 3, 4}, alarms={3, 4, 6})
    confusion = scored(make_plan, recorder, 8).links[0].detector
    assert counts(confusion) == (2, 1, 1, 4)
    assert confusion.recall == pytest.approx(2 / 3)
    assert confusion.precision == pytest.approx(2 / 3)
    assert confusion.false_alarm_rate == pytest.approx(1 / 5)


def test_an_attacked_packet_that_was_lost_is_not_counted(make_plan, recorder):
    play(recorder, 4, attacked={1, 2}, alarms={2}, missing={1})
    assert counts(scored(make_plan, recorder, 4).detector) == (1, 0, 0, 2)


def test_a_delivered_packet_without_verdict_was_accepted(make_plan, recorder):
    play(recorder, 2, attacked=(), alarms=())
    recorder.inbox("e1", 1, [("s1", 100)], "second")
    assert counts(scored(make_plan, recorder, 2).detector) == (0, 0, 0, 3)


def test_a_link_without_any_verdict_is_not_judged(make_plan, recorder):
    recorder.truth(0, [0.0])
    recorder.inbox("e1", 0, [("s1", 0)])
    recorder.channel(0, events=[(LINK, "bias", 0, "attacked")])
    recorder.estimate("e1", 0, [0.0])
    result = scored(make_plan, recorder, 1)
    assert result.links[0].detector is None
    assert result.detector is None
    (window,) = result.windows
    assert (window.judged, window.delay, window.release) == (False, None, None)


def test_equal_sequence_numbers_of_two_senders_are_two_packets(make_plan, recorder):
    recorder.truth(0, [0.0])
    recorder.inbox("e1", 0, [("s1", 7), ("s2", 7)])
    recorder.inbox("e1", 0, [("e2", 7)], "exchange")
    recorder.channel(0, events=[("s2->e1", "bias", 7, "attacked")])
    recorder.estimate("e1", 0, [0.0], verdicts=[("s1", 7, False), ("s2", 7, True), ("e2", 7, True)])
    recorder.estimate("e2", 0, [0.0])
    plan = make_plan(1, {"e1": ["s1", "s2"], "e2": []}, {"e1": ["e2"]})
    links = {link.name: link.detector for link in score(plan, recorder.records, state_groups={}).links}
    assert counts(links["s1->e1"]) == (0, 0, 0, 1)
    assert counts(links["s2->e1"]) == (1, 0, 0, 0)
    assert counts(links["e2->e1"]) == (0, 1, 0, 0)


def test_a_delayed_packet_is_judged_where_it_arrives(make_plan, recorder):
    for step in range(4):
        recorder.truth(step, [0.0])
    recorder.channel(0, events=[(LINK, "bias", 0, "attacked")])
    recorder.inbox("e1", 3, [("s1", 0)])
    for step in range(4):
        recorder.estimate("e1", step, [0.0], verdicts=[("s1", 0, True)] if step == 3 else [])
    result = scored(make_plan, recorder, 4)
    assert counts(result.detector) == (1, 0, 0, 0)
    assert (result.windows[0].first, result.windows[0].delay) == (3, 0)


def test_a_replayed_packet_was_genuine_when_it_first_came(make_plan, recorder):
    for step in range(6):
        recorder.truth(step, [0.0])
        if step in (1, 5):
            recorder.inbox("e1", step, [("s1", 1)])
        recorder.channel(step, events=[(LINK, "replay", 1, "attacked")] if step == 5 else [])
        recorder.estimate("e1", step, [0.0], verdicts=[("s1", 1, step == 5)] if step in (1, 5) else [])
    assert counts(scored(make_plan, recorder, 6).detector) == (1, 0, 0, 1)


def test_a_verdict_on_a_packet_that_never_came_is_told(make_plan, recorder):
    play(recorder, 2, attacked=(), alarms=())
    recorder.records.pop()
    recorder.estimate("e1", 1, [0.0], verdicts=[("s1", 1, False), ("s1", 99, True), ("s8", 1, True)])
    assert scored(make_plan, recorder, 2).unmatched_verdicts == 2


def test_delay_and_release_count_steps_from_the_first_chance(make_plan, recorder):
    play(recorder, 12, attacked={3, 4, 5}, alarms={4, 5, 6, 7, 8}, missing={6})
    assert scored(make_plan, recorder, 12).windows == [
        AttackWindow(
            link=LINK,
            stage="bias",
            judged=True,
            first=3,
            last=5,
            packets=3,
            rejected=2,
            delay=1,
            censored=False,
            release=2,
        )
    ]


def test_an_alarm_after_the_window_comes_too_late_unless_grace_is_given(make_plan, recorder):
    play(recorder, 8, attacked={2, 3}, alarms={5})
    strict, lenient = (scored(make_plan, recorder, 8, detection_grace=grace).windows[0] for grace in (0, 2))
    assert (strict.delay, strict.censored) == (None, False)
    assert lenient.delay == 3


def test_an_undetected_attack_that_lasts_to_the_end_is_censored(make_plan, recorder):
    play(recorder, 4, attacked={2, 3}, alarms=())
    (window,) = scored(make_plan, recorder, 4).windows
    assert (window.delay, window.censored, window.release) == (None, True, None)


def test_each_attack_stage_has_its_window(make_plan, recorder):
    play(recorder, 10, attacked={1, 2}, alarms={1, 2, 7})
    recorder.channel(7, events=[(LINK, "other", 7, "attacked")])
    plan = make_plan(10, {"e1": ["s1"]}, stages=("bias", "other"))
    windows = score(plan, recorder.records, state_groups={}).windows
    assert [(window.stage, window.first, window.last) for window in windows] == [
        ("bias", 1, 2),
        ("other", 7, 7),
    ]


def test_a_detector_that_never_accepts_again_is_locked_out(make_plan, recorder):
    play(recorder, 30, attacked={5, 6}, alarms=set(range(5, 30)), missing={9})
    (lockout,) = scored(make_plan, recorder, 30).lockouts
    assert (lockout.node, lockout.link, lockout.first_step, lockout.packets) == ("e1", LINK, 7, 22)


@pytest.mark.parametrize(("accepted", "expected"), [(19, 1), (20, 0), (29, 0)])
def test_a_lockout_needs_ten_genuine_packets_up_to_the_end(make_plan, recorder, accepted, expected):
    play(recorder, 30, attacked=(), alarms=set(range(5, 30)) - {accepted})
    assert len(scored(make_plan, recorder, 30).lockouts) == expected


def test_the_lockout_length_is_an_option(make_plan, recorder):
    play(recorder, 8, attacked=(), alarms={4, 5, 6, 7})
    assert not scored(make_plan, recorder, 8).lockouts
    assert len(scored(make_plan, recorder, 8, lockout_length=4).lockouts) == 1


def arrived(recorder, step, packets, verdicts, injected=()):
    """Record packets (source, sequence, value), a verdict on each, and injections (link, sequence, norm)."""
    recorder.truth(step, [0.0])
    recorder.inbox("e1", step, [packet[:2] for packet in packets], "correct")
    topic, inbox = recorder.records[-1]
    values = [value for _, _, value in packets]
    recorder.records[-1] = topic, msgspec.structs.replace(inbox, values=values)
    recorder.channel(step, events=[(link, "bias", sequence, "injected") for link, sequence, _ in injected])
    topic, events = recorder.records[-1]
    sizes = [size for _, _, size in injected]
    recorder.records[-1] = topic, msgspec.structs.replace(events, event_magnitude=sizes)
    judged = [(*packet[:2], alarm) for packet, alarm in zip(packets, verdicts, strict=True)]
    recorder.estimate("e1", step, [0.0], verdicts=judged)


def test_an_injected_packet_is_false_and_the_genuine_one_of_its_number_is_not(make_plan, recorder):
    packets = [("s1", 0, 9.0), ("s1", 0, 1.0), ("s1", 0, -7.0)]
    arrived(recorder, 0, packets, [True, False, False], injected=[(LINK, 0, 7.0), (LINK, 0, 9.0)])
    result = scored(make_plan, recorder, 1)
    assert counts(result.detector) == (1, 0, 1, 1)
    (window,) = result.windows
    assert (window.packets, window.rejected, window.delay) == (2, 1, 0)


def test_a_packet_in_anothers_name_is_false_where_its_name_leads(make_plan, recorder):
    packets = [("s1", 0, 5.0), ("s1", 0, 1.0), ("s2", 0, 2.0)]
    arrived(recorder, 0, packets, [True, False, False], injected=[("s2->e1", 0, 5.0)])
    plan = make_plan(1, {"e1": ["s1", "s2"]})
    result = score(plan, recorder.records, state_groups={})
    assert [counts(link.detector) for link in result.links] == [(1, 0, 0, 1), (0, 0, 0, 1)]
    assert result.windows[0].link == LINK


def test_injected_packets_that_never_arrived_make_nothing_false(make_plan, recorder):
    arrived(recorder, 0, [("s1", 0, 1.0)], [False], injected=[(LINK, 0, 9.0)])
    assert counts(scored(make_plan, recorder, 1).detector) == (0, 0, 0, 1)


def test_one_verdict_on_several_packets_of_one_number_stands_for_all(make_plan, recorder):
    arrived(recorder, 0, [("s1", 0, 1.0), ("s1", 0, 9.0)], [True, True], injected=[(LINK, 0, 9.0)])
    topic, estimate = recorder.records[-1]
    once = {"detector_source": ["s1"], "detector_sequence": [0], "detector_statistic": [1.0]}
    recorder.records[-1] = topic, msgspec.structs.replace(estimate, **once, detector_alarm=[True])
    assert counts(scored(make_plan, recorder, 1).detector) == (1, 1, 0, 0)


def test_packets_that_the_receiver_refused_by_name_or_seal_are_no_business_of_its_detector(
    make_plan, recorder
):
    arrived(recorder, 0, [("s1", 0, 1.0), ("s9", 0, 2.0)], [False, False])
    topic, estimate = recorder.records[-1]
    once = {"detector_source": ["s1"], "detector_sequence": [0], "detector_statistic": [1.0]}
    recorder.records[-1] = topic, msgspec.structs.replace(estimate, **once, detector_alarm=[False])
    assert counts(scored(make_plan, recorder, 1).detector) == (0, 0, 0, 1)
    plan = make_plan(1, {"e1": ["s1"]})
    fields = {name: getattr(plan, name) for name in plan.__dataclass_fields__} | {"integrity": {"s1": "mac"}}
    total = score(type(plan)(**fields), recorder.records, state_groups={}).detector
    assert counts(total) == (0, 0, 0, 0)
