"""The report of many trials: of a campaign, or of several runs and campaigns side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.evidence.detectors import Detection
from orchestrator.evidence.figures import rmse
from orchestrator.evidence.sources import Source
from orchestrator.report.campaign_calibration import calibration_blocks
from orchestrator.report.campaign_consistency import consistency_curves
from orchestrator.report.campaign_detection import detections, operating_figure, roc_curves, survival_figure
from orchestrator.report.campaign_errors import error_curves, outcome_figure, trial_spread
from orchestrator.report.campaign_tables import (
    bound_blocks,
    consistency_table,
    detection_table,
    error_table,
    failure_table,
    interval,
    origin_table,
    variant_table,
)
from orchestrator.report.campaign_traffic import disagreement_figure, pareto_figure
from orchestrator.report.comparison import comparison_blocks, price_tables
from orchestrator.report.contents import Block, Page, Section, Text, Tile
from orchestrator.report.groups import By, Group, Outcomes, find_groups, state_names


def _detection_blocks(groups: Sequence[Group]) -> list[Block]:
    found = detections(groups)
    return [*_packet_blocks(found), *calibration_blocks(groups)]


def _packet_blocks(found: Mapping[str, Detection]) -> list[Block]:
    if not found:
        return [Text("No estimator judged any packet: there is no detector of packets to report on.")]
    figures = [roc_curves(found), survival_figure(found), operating_figure(found)]
    blocks: list[Block] = [detection_table(found), *(own for own in figures if own)]
    if figures[0] is None:
        blocks.append(Text("There is no ROC: it needs both attacked and genuine packets with a verdict."))
    return blocks


def _headline(groups: Sequence[Group]) -> str:
    """Return in a sentence what became of the trials, and who erred least."""
    own = Outcomes.of(groups)
    told = f"All that was expected held in {own.passed:,} of {own.trials:,} trials"
    told += f"; in {own.diverged:,} an estimator diverged" if own.diverged else "; no estimator diverged"
    state = state_names(groups)[0]
    errors = {group.name: rmse(group.rows, state, group.confidence) for group in groups}
    known = {name: own for name, own in errors.items() if np.isfinite(own.value)}
    if len(known) < 2:
        return f"{told}."
    best = min(known, key=lambda name: known[name].value)
    where = "the state" if state == "state" else state
    return f"{told}. The smallest RMSE of {where} is that of {best}: {interval(known[best])}."


def _tiles(groups: Sequence[Group]) -> list[Tile]:
    own = Outcomes.of(groups)
    scored = max(own.trials - own.failed, 1)
    variants = len({group.variant for group in groups})
    return [
        Tile("Variants", f"{variants}", f"{len(groups)} groups of estimators"),
        Tile("Trials", f"{own.trials:,}", _each(own.trials, variants)),
        Tile("Passed", f"{100 * own.passed / max(own.trials, 1):.3g} %", f"{own.passed:,} of {own.trials:,}"),
        Tile(
            "Diverged",
            f"{100 * own.diverged / scored:.3g} %",
            f"{own.diverged:,} of {scored:,}",
            tone="bad" if own.diverged else "plain",
        ),
        Tile("Without a score", f"{own.failed:,}", tone="warn" if own.failed else "plain"),
    ]


def campaign_page(sources: Sequence[Source], by: By | None = None) -> Page:
    """Return the page of a campaign, or of several sources side by side; ``by`` as `find_groups` says."""
    notes: list[str] = []
    groups = find_groups(sources, by, notes)
    sections = [
        Section("variants-section", "Variants", _variant_blocks(groups, sources)),
        Section("errors-section", "Errors", _error_blocks(groups, notes)),
        Section("consistency-section", "Consistency", _consistency_blocks(groups, notes)),
        Section("detection-section", "Detection", _detection_blocks(groups)),
        Section("communication-section", "Communication", _communication_blocks(groups)),
        Section("origin-section", "Provenance", [origin_table(source) for source in sources]),
    ]
    compared = comparison_blocks(groups, notes)
    if compared:
        sections.insert(1, Section("comparison-section", "Comparison", compared))
    failed = bool(Outcomes.of(groups).failed)
    return Page(
        title=" and ".join(dict.fromkeys(source.name for source in sources)),
        kind="Campaign report" if len(sources) == 1 else "Comparison",
        word="PARTLY FAILED" if failed else "DONE",
        tone="warn" if failed else "plain",
        headline=_headline(groups),
        facts=_facts(groups),
        tiles=_tiles(groups),
        sections=sections,
        notes=notes,
    )


def _variant_blocks(groups: Sequence[Group], sources: Sequence[Source]) -> list[Block]:
    failures = failure_table(sources)
    return [variant_table(groups), outcome_figure(groups), *([failures] if failures else [])]


def _error_blocks(groups: Sequence[Group], notes: list[str]) -> list[Block]:
    return [
        error_table(groups),
        error_curves(groups, notes),
        trial_spread(groups),
        *price_tables(groups),
        *bound_blocks(groups),
    ]


def _consistency_blocks(groups: Sequence[Group], notes: list[str]) -> list[Block]:
    curves = consistency_curves(groups, notes)
    return [consistency_table(groups), *([curves] if curves else [])]


def _communication_blocks(groups: Sequence[Group]) -> list[Block]:
    found = [own for own in (pareto_figure(groups), disagreement_figure(groups)) if own]
    return [*found] or [Text("There is one group of estimators, and no network in which to disagree.")]


def _each(trials: int, variants: int) -> str:
    return f"{trials // variants:,} of each" if variants > 1 and trials % variants == 0 else ""


def _facts(groups: Sequence[Group]) -> str:
    lengths = dict.fromkeys(f"{group.rows.steps:,} steps of {group.period_s:g} s" for group in groups)
    confidence = f"{100 * groups[0].confidence:g} %"
    return f"{' or '.join(lengths)}; intervals hold with {confidence} confidence over trials."
