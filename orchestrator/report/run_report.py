"""The report of one run: what it holds, in what order, and the words around it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orchestrator.report.consistency import over_time_figure, summary_figure
from orchestrator.report.contents import Block, Mark, Page, Section, Table, Text, Tile
from orchestrator.report.detection import roc_figure, run_curves, timeline_figure
from orchestrator.report.network import network_figure
from orchestrator.report.recording import Recording, read_recording
from orchestrator.report.signals import signal_figure
from orchestrator.report.thinning import STRETCHES
from orchestrator.report.tracking import disagreement_figure, error_figure, tracking_figure
from orchestrator.report.traffic import link_table, matrix_figure, rate_figure
from orchestrator.score.gather import Bools
from orchestrator.score.headline import headline
from orchestrator.score.judging import show
from orchestrator.score.link_results import AttackWindow
from orchestrator.score.results import Consistency, NodeScore, Outcome, Score

TONES = {"PASSED": "good", "FAILED": "bad", "INCOMPLETE": "warn", "DONE": "plain"}
WINDOW_ROWS = 200
FEW_LINKS = 4


def percent(share: float | None) -> str:
    """Return a share for people."""
    return "-" if share is None else f"{100 * share:.3g} %"


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _ratio(figures: Consistency) -> str:
    return _figure(figures.mean / figures.dof) if figures.mean is not None and figures.dof else "-"


def _tiles(score: Score) -> list[Tile]:
    packets, judged = score.traffic, score.detector
    diverged = sum(node.divergence_step is not None for node in score.nodes)
    held = sum(outcome.passed for outcome in score.expectations)
    tiles = [
        *_missing(score),
        Tile(
            "Expectations held",
            f"{held} of {len(score.expectations)}" if score.expectations else "none",
            tone="bad" if held < len(score.expectations) else "plain",
        ),
        Tile("Estimators diverged", f"{diverged} of {len(score.nodes)}", tone="bad" if diverged else "plain"),
        Tile("Packets lost", percent(packets.lost_share), f"{packets.lost:,} of {packets.sent:,}"),
        Tile("Packets attacked", f"{packets.attacked + packets.injected:,}", _attack_remark(score)),
    ]
    if judged is None:
        return [*tiles, Tile("Detector", "none", "no verdict on any packet")]
    attacked = judged.true_positive + judged.false_negative
    genuine = judged.false_positive + judged.true_negative
    return [
        *tiles,
        Tile(
            "Attacked packets rejected", percent(judged.recall), f"{judged.true_positive:,} of {attacked:,}"
        ),
        Tile(
            "Genuine packets rejected",
            percent(judged.false_alarm_rate),
            f"{judged.false_positive:,} of {genuine:,}",
            tone="warn" if score.lockouts else "plain",
        ),
    ]


def _missing(score: Score) -> list[Tile]:
    """Return how much of the run is there, where that is not all of it."""
    if score.complete:
        return []
    missing = score.steps - score.steps_recorded
    return [
        Tile(
            "Steps recorded",
            f"{score.steps_recorded:,} of {score.steps:,}",
            f"{missing:,} missing",
            tone="warn",
        )
    ]


def _attack_remark(score: Score) -> str:
    links = {window.link for window in score.windows}
    return f"on {len(links)} of {len(score.links)} links" if links else ""


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


def _remark(node: NodeScore, score: Score) -> str:
    parts = [f"PRIVILEGED: told of {', '.join(node.privileged)}"] if node.privileged else []
    if node.divergence_step is not None:
        parts.append(f"diverged at step {node.divergence_step}")
    if node.silent_from is not None:
        parts.append(f"silent from step {node.silent_from}")
    parts += [f"deaf from step {out.first_step}" for out in score.lockouts if out.node == node.name]
    if node.attacked_steps:
        parts.append(f"attacked in {node.attacked_steps} steps")
    return ", ".join(parts)


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
            _remark(node, score),
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


def _after(steps: int) -> str:
    return "at once" if steps == 0 else f"after {steps} step{'' if steps == 1 else 's'}"


def _window_row(window: AttackWindow) -> tuple[str | Mark, ...]:
    if not window.judged:
        answer, rejected, release = Mark("no detector", "plain"), "-", "-"
    else:
        rejected = f"{window.rejected} of {window.packets}"
        release = "never" if window.release is None else _after(window.release)
        answer = Mark("missed", "bad")
        if window.delay is not None:
            answer = Mark(_after(window.delay), "good")
        elif window.censored:
            answer = Mark("run ended first", "warn")
    stage = window.stage.removesuffix(f"@{window.link}")
    return (window.link, stage, f"{window.first} to {window.last}", rejected, answer, release)


def _window_table(score: Score, notes: list[str]) -> Table:
    if len(score.windows) > WINDOW_ROWS:
        notes.append(f"The table of attacks has {WINDOW_ROWS} of {len(score.windows)} rows.")
    return Table(
        "Attacks, and what the detectors made of them",
        ("link", "attack", "steps", "rejected", "first alarm", "trusted again"),
        [_window_row(window) for window in score.windows[:WINDOW_ROWS]],
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
        state += f"; {recording.score.steps_recorded} of {recording.score.steps} steps"
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
        blocks.append(_window_table(score, notes))
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
        tiles=_tiles(score),
        sections=sections,
        notes=notes,
    )
