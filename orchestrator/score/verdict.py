"""The verdict: what a score says, for people, on a terminal or in plain text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.text import Text

from orchestrator.score.headline import headline, percent, several
from orchestrator.score.judging import show
from orchestrator.score.link_results import SenderScore
from orchestrator.score.measure import pooled_senders
from orchestrator.score.results import Outcome, Score
from orchestrator.score.verdict_tables import attack_table, estimator_tables, signal_table

EXPECTATION_LINES = 8


def _run_line(score: Score) -> str:
    run = f"{score.name}, seed {score.seed}, trial {score.trial}: "
    run += f"{score.steps} steps of {show(score.period_s)} s, {several(len(score.nodes), 'estimator')}"
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
        lost += f" ({percent(packets.lost_share)}{burst})"
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
    senders = ranked[0].name if len(ranked) == 1 else several(len(ranked), "sender")
    return f"Event triggers: {senders} used {percent(whole.rate)} of {whole.slots} slots{span}."


def _use(sender: SenderScore) -> str:
    return f"{sender.name} {percent(sender.rate or 0.0)}"


def _detector_line(score: Score) -> str | None:
    parts = _judged_parts(score)
    if score.unmatched_verdicts:
        parts.append(f"{several(score.unmatched_verdicts, 'verdict')} on packets that never came")
    return f"Detectors: {', '.join(parts)}." if parts else None


def _judged_parts(score: Score) -> list[str]:
    judged = score.detector
    if judged is None:
        return []
    attacked = judged.true_positive + judged.false_negative
    genuine = judged.false_positive + judged.true_negative
    parts = []
    if attacked:
        parts.append(f"{judged.true_positive} of {attacked} attacked packets rejected")
    rate = f" ({percent(judged.false_alarm_rate)})" if judged.false_alarm_rate is not None else ""
    return [*parts, f"{judged.false_positive} of {genuine} genuine packets rejected{rate}"]


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
    console.print(estimator_tables(score, console.width))
    for table in (signal_table(score, console.width), attack_table(score, console.width)):
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
