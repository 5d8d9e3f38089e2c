"""The report of one run: what it holds, in what order, and the words around it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orchestrator.report.consistency import over_time_figure, summary_figure
from orchestrator.report.contents import Block, Mark, Page, Section, Table, Text
from orchestrator.report.detection import roc_figure, run_curves, timeline_figure
from orchestrator.report.network import network_figure
from orchestrator.report.recording import Recording, read_recording
from orchestrator.report.run_tiles import run_tiles
from orchestrator.report.signals import signal_figure
from orchestrator.report.thinning import STRETCHES
from orchestrator.report.tracking import disagreement_figure, error_figure, tracking_figure
from orchestrator.report.traffic import link_table, matrix_figure, rate_figure
from orchestrator.score.gather import Bools
from orchestrator.score.headline import extent, headline
from orchestrator.score.judging import show
from orchestrator.score.link_results import AttackWindow, Confusion
from orchestrator.score.remarks import alarm_after, false_alarms, rejected, remarks, trusted_after
from orchestrator.score.results import Consistency, Outcome, Score

TONES = {"PASSED": "good", "FAILED": "bad", "INCOMPLETE": "warn", "DONE": "plain"}
WINDOW_ROWS = 200
FEW_LINKS = 4


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _ratio(figures: Consistency) -> str:
    return _figure(figures.mean / figures.dof) if figures.mean is not None and figures.dof else "-"


def verdict_table(score: Score) -> Table:
    """Return the expectations and what became of each, those that failed first."""
    words = {"<=": "at most", ">=": "at least", "==": "exactly"}
    rows = [
        (
            Mark("held", "good") if outcome.passed else Mark("failed", "bad"),
            outcome.metric,
            f"{words[outcome.relation]} {show(outcome.bound)}",
            "see beside" if outcome.measured is None else show(outcome.measured),
            _where(outcome),
        )
        for outcome in sorted(score.expectations, key=lambda outcome: outcome.passed)
    ]
    return Table("Expectations", ("", "metric", "expected", "measured", "where"), rows, frozenset({0, 1, 4}))


def _where(outcome: Outcome) -> str:
    """Return where an expectation was measured and of how many that was the worst, or why it was not."""
    told = outcome.message.partition(": ")[2]
    return told if outcome.measured is None else told.partition(" (")[2].removesuffix(")")


def _node_table(score: Score) -> Table:
    groups = list(score.nodes[0].groups)
    rows = [
        (
            node.name,
            node.method,
            *(_figure(node.groups[group].rmse) for group in groups),
            *(_figure(node.groups[group].peak) for group in groups[-1:]),
            _ratio(node.nees),
            _ratio(node.nis),
            ", ".join(remarks(node, score)),
        )
        for node in score.nodes
    ]
    columns = (
        *("estimator", "method"),
        *(f"RMSE {group}" for group in groups),
        *("peak", "NEES by dof", "NIS by dof", "remarks"),
    )
    few = len(rows) <= 6
    return Table(
        f"Figures of each estimator ({len(rows)})",
        columns,
        rows,
        frozenset({0, 1, len(columns) - 1}),
        folded=not few,
    )


def _window_row(window: AttackWindow, score: Score, judged: Confusion | None) -> tuple[str | Mark, ...]:
    """Return the row of an attack; its first alarm is good where most of its packets were rejected."""
    tone = "plain"
    if window.judged:
        tone = "warn" if window.delay is not None or window.censored else "bad"
    if window.delay is not None and window.rejected >= 0.5 * window.packets:
        tone = "good"
    return (
        window.link,
        window.stage.removesuffix(f"@{window.link}"),
        f"{window.first} to {window.last}",
        rejected(window),
        false_alarms(judged),
        Mark(alarm_after(window), tone),
        trusted_after(window, score) or "-",
    )


def window_table(score: Score, notes: list[str]) -> Table:
    """Return what the detectors made of each attack on each link."""
    if len(score.windows) > WINDOW_ROWS:
        notes.append(f"The table of attacks has {WINDOW_ROWS} of {len(score.windows)} rows.")
    judged = {link.name: link.detector for link in score.links}
    return Table(
        "Attacks, and what the detectors made of them",
        ("attacked link", "by", "steps", "rejected", "false alarms", "alarm after", "trusted after"),
        [_window_row(window, score, judged[window.link]) for window in score.windows[:WINDOW_ROWS]],
        frozenset({0, 1}),
    )


def _origin_table(recording: Recording, path: Path) -> Table:
    facts = recording.log.provenance
    versions = ", ".join(
        f"{key.removeprefix('version.')} {value}"
        for key, value in facts.items()
        if key.startswith("version.")
    )
    state = "complete" if recording.log.complete else "incomplete"
    if recording.log.truncated:
        state = "cut off; gauntlet log recover makes it whole"
    if not recording.score.complete:
        state += f"; {extent(recording.score)}"
    rows = [
        ("log", str(path)),
        ("topology", facts["name"]),
        ("topology hash", facts.get("topology_hash", "none")),
        ("seed, trial", f"{facts['seed']}, {facts.get('trial', '0')}"),
        ("steps", f"{facts['steps']} of {float(facts['period_s']):g} s"),
        ("record", f"{state}, recovered" if recording.log.outcome.get("recovered") == "true" else state),
        ("commit", facts.get("git_commit", "none")),
        ("machine", facts.get("machine", "none")),
        ("versions", versions),
    ]
    return Table("Where this comes from", (), rows, frozenset({0, 1}))


def _facts(score: Score) -> str:
    counted = f", errors counted from step {score.options.from_step}" if score.options.from_step else ""
    return (
        f"{score.steps} steps of {score.period_s:g} s with {len(score.nodes)} "
        f"estimator{'' if len(score.nodes) == 1 else 's'} over {len(score.links)} links; "
        f"seed {score.seed}, trial {score.trial}{counted}."
    )


def _detection_blocks(recording: Recording, notes: list[str]) -> list[Block]:
    score = recording.score
    blocks: list[Block] = []
    if score.windows:
        blocks.append(window_table(score, notes))
    timeline = timeline_figure(recording, notes)
    if timeline is None:
        told = "No estimator gave a verdict with a test statistic on any packet."
        return [*blocks, Text(told)]
    blocks.append(timeline)
    curves = roc_figure(run_curves(recording))
    if curves is None:
        return [*blocks, Text("There is no ROC: it needs both attacked and genuine packets with a verdict.")]
    return [*blocks, curves]


def _windows(marks: Bools) -> int:
    """Return how many runs of marked steps there are."""
    return int(np.sum(np.diff(marks.astype(np.int8), prepend=0) == 1))


def run_page(path: Path) -> Page:
    """Return the page of one run, given its log."""
    notes: list[str] = []
    recording = read_recording(path)
    score = recording.score
    word, _, rest = headline(score).partition(": ")
    if max(_windows(own) for own in recording.attacked) > STRETCHES:
        notes.append(f"More than {STRETCHES} stretches of attacked steps are shaded with short gaps joined.")
    signal = signal_figure(recording)
    over_time, apart = over_time_figure(recording, notes), disagreement_figure(recording)
    sections = [
        Section("network-section", "Network", [network_figure(recording)]),
        Section(
            "tracking-section",
            "Truth and estimates",
            [tracking_figure(recording, notes), *([signal] if signal else [])],
        ),
        Section(
            "errors-section",
            "Errors",
            [error_figure(recording, notes), *([apart] if apart else []), _node_table(score)],
        ),
        Section(
            "consistency-section",
            "Consistency",
            [
                *([summary_figure(recording)] if len(score.nodes) > 1 else []),
                over_time or Text("No estimator gave a usable covariance or an NIS."),
            ],
        ),
        Section("detection-section", "Detection", _detection_blocks(recording, notes)),
        Section(
            "communication-section",
            "Communication",
            [
                rate_figure(recording, notes),
                *([matrix_figure(recording, notes)] if len(score.links) > FEW_LINKS else []),
                link_table(recording, notes),
            ],
        ),
        Section("origin-section", "Provenance", [_origin_table(recording, path)]),
    ]
    if score.expectations:
        sections.insert(0, Section("verdicts-section", "Verdicts", [verdict_table(score)]))
    return Page(
        title=recording.topology.name,
        kind="Run report",
        word=word,
        tone=TONES[word],
        headline=rest[:1].upper() + rest[1:],
        facts=_facts(score),
        tiles=run_tiles(score),
        sections=sections,
        notes=notes,
    )
