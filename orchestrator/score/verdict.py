"""The verdict: what a score says, for people, on a terminal or in plain text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from statistics import median
from typing import NamedTuple

from rich.console import Console
from rich.text import Text

from orchestrator.score.judging import show
from orchestrator.score.link_results import SenderScore
from orchestrator.score.measure import expected_estimates, pooled_senders
from orchestrator.score.results import NodeScore, Outcome, Score
from orchestrator.score.verdict_tables import attack_table, estimator_tables, signal_table

TRACKING_RATIO = 2.0
"""How many times the usual error an attacked estimator may show and still be said to keep tracking."""

EXPECTATION_LINES = 8


def _several(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _listed(names: Sequence[str], noun: str, most: int = 3) -> str:
    """Return ``a, b and c``, or how many there are when they are too many to name."""
    if len(names) > most:
        return _several(len(names), noun)
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _percent(part: float) -> str:
    return f"{100 * part:.3g} %"


class Excess(NamedTuple):
    """How many times the usual an estimator's error is, in one state group."""

    node: str
    group: str
    ratio: float


def excess(score: Score) -> Excess | None:
    """Return the attacked estimator whose error is most out of the usual, in the group where it is so.

    The usual is the median RMSE over estimators of the same method that no attacked packet reached, or, where
    there is none, the estimator's own RMSE over its unattacked steps. Groups are compared one by one: in the
    whole state, a group of large numbers would hide another. None when there is nothing to compare.
    """
    found = [
        Excess(node.name, group, compared / usual)
        for node in score.nodes
        if node.attacked_steps
        for group in node.groups
        for usual, compared in [_usual_and_own(node, group, score.nodes)]
        if usual and compared is not None
    ]
    return max(found, key=lambda each: each.ratio, default=None)


def overconfidence(score: Score) -> Excess | None:
    """Return the estimator whose errors most exceed what its covariance says, as a ratio of lengths.

    It is the square root of the mean NEES by its degrees of freedom: about 1 for a consistent estimator. None
    when no estimator gave a covariance.
    """
    found = [
        Excess(node.name, "state", (node.nees.mean / node.nees.dof) ** 0.5)
        for node in score.nodes
        if node.nees.mean is not None and node.nees.dof
    ]
    return max(found, key=lambda each: each.ratio, default=None)


def _usual_and_own(
    node: NodeScore, group: str, nodes: Sequence[NodeScore]
) -> tuple[float | None, float | None]:
    """Return the usual error in a group, and that of one node to compare with it."""
    peers = (
        other.groups[group].rmse
        for other in nodes
        if other.method == node.method and not other.attacked_steps
    )
    spared = [rmse for rmse in peers if rmse is not None]
    own = node.groups[group]
    return (median(spared), own.rmse) if spared else (own.unattacked, own.attacked)


def _subject(score: Score) -> str:
    if len(score.nodes) == 1:
        return f"the estimator {score.nodes[0].name}"
    if len(score.networks) == 1 and score.networks[0].disagreement is not None:
        return "the network"
    there = [node for node in score.nodes if node.silent_from is None] or score.nodes
    other = "other " if len(there) < len(score.nodes) else ""
    if len(there) == 1:
        return f"the {other}estimator {there[0].name}"
    return f"all {len(there)} {other}estimators"


def _circumstance(score: Score) -> str:
    links = list(dict.fromkeys(window.link for window in score.windows))
    if not links and any(node.attacked_steps for node in score.nodes):
        return " through the attack on the plant"
    if links:
        return f" through the attack on {_listed(links, 'link')}"
    if score.traffic.lost_share:
        return f" with {_percent(score.traffic.lost_share)} of the packets lost"
    return ""


def _divergences(nodes: Iterable[NodeScore]) -> list[str]:
    return [
        f"{node.name} at step {node.divergence_step}" for node in nodes if node.divergence_step is not None
    ]


def _story(score: Score) -> str:
    """Return what became of the estimators, in half a sentence."""
    planned = [
        f"{node.name} from step {node.silent_from}"
        for node in score.nodes
        if node.silent_from is not None and node.name not in score.departed
    ]
    died = [f"{name} in step {step}" for name, step in score.departed.items()]
    fallen = f", while {_listed(planned, '')} fell silent by plan" if planned else ""
    named = _listed(died, "") if len(died) <= 3 else _several(len(died), "node")
    lost = f", though the run lost {named}" if died else ""
    return _fate(score) + fallen + lost


def _fate(score: Score) -> str:
    """Return what became of the estimators that were there to the end, or as long as they were."""
    parts = []
    diverged = _divergences(score.nodes)
    if diverged:
        named = f" ({_listed(diverged, '')})" if len(diverged) <= 3 else ""
        parts.append(f"{len(diverged)} of {_several(len(score.nodes), 'estimator')} diverged{named}")
    if score.lockouts:
        deaf = [f"{lockout.node} to {lockout.link.partition('->')[0]}" for lockout in score.lockouts]
        named = f" ({_listed(deaf, '')})" if len(deaf) <= 3 else ""
        parts.append(f"{_several(len(deaf), 'detector')} locked out for good{named}")
    if parts:
        return " and ".join(parts)
    if all(node.groups["state"].rmse is None for node in score.nodes):
        return "no estimate was scored"
    worst = excess(score)
    if worst is not None and worst.ratio > TRACKING_RATIO:
        where = "" if worst.group == "state" else f" in {worst.group}"
        error = f"but {worst.node} erred {show(round(worst.ratio, 1))} times the usual{where}"
        return f"no estimator diverged{_circumstance(score)}, {error}"
    deluded = overconfidence(score)
    if deluded is not None and deluded.ratio > TRACKING_RATIO:
        error = f"but {deluded.node} erred {show(round(deluded.ratio, 1))} times what it believed"
        return f"no estimator diverged{_circumstance(score)}, {error}"
    return f"{_subject(score)} kept tracking{_circumstance(score)}"


def headline(score: Score) -> str:
    """Return the verdict in one sentence.

    It begins with ``PASSED``, ``FAILED``, ``INCOMPLETE``, or ``DONE`` when nothing was expected.
    """
    expected = len(score.expectations)
    failed = [outcome.metric for outcome in score.expectations if not outcome.passed]
    if not score.complete:
        missing = _several(
            int(sum(expected_estimates(score, node) - node.steps_scored for node in score.nodes)), "estimate"
        )
        return f"INCOMPLETE: {missing} missing from the record; as far as it goes, {_story(score)}."
    if failed:
        named = _listed(list(dict.fromkeys(failed)), "metric")
        return (
            f"FAILED: {len(failed)} of {_several(expected, 'expectation')} failed ({named}); {_story(score)}."
        )
    if not expected:
        return f"DONE: {_story(score)}; nothing was expected of it."
    held = "the expectation" if expected == 1 else f"all {expected} expectations"
    return f"PASSED: {_story(score)}; {held} held."


def _run_line(score: Score) -> str:
    run = f"{score.name}, seed {score.seed}, trial {score.trial}: "
    run += f"{score.steps} steps of {show(score.period_s)} s, {_several(len(score.nodes), 'estimator')}"
    if score.options.from_step:
        run += f", errors scored from step {score.options.from_step}"
    return run


def _timing_line(timing: Mapping[str, float]) -> str:
    parts = []
    for name, value in timing.items():
        if name == "steps_per_s":
            parts.append(f"{value:.0f} steps/s")
        elif name.endswith("_s"):
            parts.append(f"{name.removesuffix('_s').replace('_', ' ')} {value:.2f} s")
    return ", ".join(parts)


def _packet_line(score: Score) -> str:
    packets = score.traffic
    lost = f"{packets.lost} lost"
    if packets.lost_share:
        burst = f", {packets.mean_loss_burst:.2g} in a row" if packets.mean_loss_burst else ""
        lost += f" ({_percent(packets.lost_share)}{burst})"
    more = "".join(
        f"{count} {what}, "
        for count, what in (
            (packets.injected, "injected"),
            (packets.duplicated, "duplicated"),
            (packets.refused, "refused"),
            (packets.in_flight, "in flight at the end"),
        )
        if count
    )
    return (
        f"Packets: {packets.sent} sent, {lost}, {packets.attacked} attacked, "
        f"{more}{packets.delivered} delivered."
    )


def _sender_line(score: Score) -> str | None:
    whole = pooled_senders(score)
    if whole.rate is None:
        return None
    ranked = sorted(
        (sender for sender in score.senders if sender.rate is not None), key=lambda sender: sender.rate or 0.0
    )
    span = "" if len(ranked) == 1 else f", from {_use(ranked[0])} to {_use(ranked[-1])}"
    senders = ranked[0].name if len(ranked) == 1 else _several(len(ranked), "sender")
    return f"Event triggers: {senders} used {_percent(whole.rate)} of {whole.slots} slots{span}."


def _use(sender: SenderScore) -> str:
    return f"{sender.name} {_percent(sender.rate or 0.0)}"


def _detector_line(score: Score) -> str | None:
    judged = score.detector
    if judged is None:
        return None
    attacked = judged.true_positive + judged.false_negative
    genuine = judged.false_positive + judged.true_negative
    parts = []
    if attacked:
        parts.append(f"{judged.true_positive} of {attacked} attacked packets rejected")
    rate = f" ({_percent(judged.false_alarm_rate)})" if judged.false_alarm_rate is not None else ""
    parts.append(f"{judged.false_positive} of {genuine} genuine packets rejected{rate}")
    if score.unmatched_verdicts:
        parts.append(f"{_several(score.unmatched_verdicts, 'verdict')} on packets that never came")
    return f"Detectors: {', '.join(parts)}."


def _expectation_lines(outcomes: Sequence[Outcome], marks: tuple[str, str]) -> list[Text]:
    """Return one line an expectation, those that failed first when there are too many for all."""
    shown = list(outcomes)
    if len(shown) > EXPECTATION_LINES:
        shown = sorted(shown, key=lambda outcome: outcome.passed)[:EXPECTATION_LINES]
    lines = [
        Text.assemble(
            "  ",
            (marks[0] if outcome.passed else marks[1], "green" if outcome.passed else "bold red"),
            f" {outcome.message}",
        )
        for outcome in shown
    ]
    if len(shown) < len(outcomes):
        hidden = [outcome for outcome in outcomes if not any(outcome is one for one in shown)]
        failed = sum(not outcome.passed for outcome in hidden)
        lines.append(Text(f"    and {len(hidden)} more, of which {failed} failed"))
    return lines


def _marks(console: Console) -> tuple[str, str]:
    """Return the signs for passed and failed that the console can write."""
    return ("✓", "✗") if console.encoding.startswith("utf") else ("ok", "NO")


def print_verdict(
    score: Score,
    console: Console,
    *,
    timing: Mapping[str, float] | None = None,
    files: Mapping[str, str] | None = None,
) -> None:
    """Print the verdict.

    Parameters
    ----------
    score
        What to tell about.
    console
        Where to; one without a terminal gets plain text.
    timing
        Wall-clock figures, which are no part of the score: ``steps_per_s`` (1/s), and any ``*_s`` (s).
    files
        Where things were written, by a word for each.
    """
    colour = {"PASSED": "bold green", "DONE": "bold", "FAILED": "bold red", "INCOMPLETE": "bold yellow"}
    sentence = headline(score)
    word = sentence.partition(":")[0]
    console.print(Text.assemble((word, colour[word]), sentence[len(word) :]))
    console.print(Text(_run_line(score), style="dim"))
    if timing:
        console.print(Text(_timing_line(timing), style="dim"))
    console.print()
    console.print(estimator_tables(score))
    for table in (signal_table(score), attack_table(score)):
        if table is not None:
            console.print()
            console.print(table)
    console.print()
    for line in (_packet_line(score), _sender_line(score), _detector_line(score)):
        if line is not None:
            console.print(Text(line))
    if score.expectations:
        console.print(Text("Expectations", style="bold"))
        for text in _expectation_lines(score.expectations, _marks(console)):
            console.print(text)
    for name, path in (files or {}).items():
        console.print(Text(f"{name}: {path}"), soft_wrap=True)
