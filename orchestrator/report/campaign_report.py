"""The report of many trials: of a campaign, or of several runs and campaigns side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from orchestrator.evidence.chosen import Chosen, shown, told_apart
from orchestrator.evidence.comparability import different_ground
from orchestrator.evidence.detectors import Detection
from orchestrator.report.best import Best, find_best
from orchestrator.report.campaign_calibration import calibration_blocks
from orchestrator.report.campaign_consistency import consistency_curves, consistency_table
from orchestrator.report.campaign_detection import detections, operating_figure, roc_curves, survival_figure
from orchestrator.report.campaign_errors import error_curves, outcome_figure, trial_spread
from orchestrator.report.campaign_tables import (
    bound_blocks,
    detection_table,
    error_table,
    failure_table,
    origin_table,
    variant_table,
)
from orchestrator.report.campaign_traffic import disagreement_figure, pareto_figure
from orchestrator.report.comparison import compared, comparison_blocks, price_tables
from orchestrator.report.contents import Block, Page, Section, Table, Text, Tile
from orchestrator.report.grouping import find_groups
from orchestrator.report.groups import Group, Outcomes, judged_by_expectations
from orchestrator.report.swept import swept_figure
from orchestrator.report.swept_pairs import pair_figures

ENOUGH = 20
"""Trials from which on resampled intervals hold nearly as often as they say."""

_FEW = (
    "Of {} trials, those that are resampled (RMSE, bands) hold less often: at 95 %, in about half of the "
    "campaigns of 2 trials, 85 % of those of 5, 90 % of those of 10."
)

LONG = 16
"""Most rows of a table that stands open, those of variants and errors aside."""


def _detection_blocks(groups: Sequence[Group]) -> list[Block]:
    found = detections(groups)
    return [*_packet_blocks(found), *calibration_blocks(groups)]


def _packet_blocks(found: Mapping[str, Detection]) -> list[Block]:
    if not found:
        return [Text("No estimator judged any packet: there is no detector of packets to report on.")]
    figures = [roc_curves(found), survival_figure(found), operating_figure(found)]
    blocks: list[Block] = [*_folded([detection_table(found)]), *(own for own in figures if own)]
    if figures[0] is None:
        blocks.append(Text("There is no ROC: it needs both attacked and genuine packets with a verdict."))
    return blocks


def _folded(blocks: Sequence[Block]) -> list[Block]:
    """Return blocks whose long tables show their caption only, until they are opened."""
    return [
        replace(own, folded=True) if isinstance(own, Table) and len(own.rows) > LONG else own
        for own in blocks
    ]


def _headline(groups: Sequence[Group], best: Best | None) -> str:
    """Return in a sentence what became of the trials, and who erred least if these can be compared."""
    held, own = Outcomes.of(judged_by_expectations(groups)), Outcomes.of(groups)
    trials = f"{held.trials:,} trials" if held.trials == own.trials else f"{held.trials:,} attacked trials"
    told = f"All that was expected held in {held.passed:,} of {trials}"
    told += f"; in {own.diverged:,} an estimator diverged" if own.diverged else "; no estimator diverged"
    return f"{told}. {best.headline}" if best else f"{told}."


def _tiles(groups: Sequence[Group]) -> list[Tile]:
    own, held = Outcomes.of(groups), Outcomes.of(judged_by_expectations(groups))
    apart = "" if held.trials == own.trials else f"; {own.trials - held.trials:,} of twins do not count"
    scored = max(own.trials - own.failed, 1)
    variants = len({group.variant for group in groups})
    return [
        Tile(
            "Variants", f"{variants}", f"{len(groups)} group{'' if len(groups) == 1 else 's'} of estimators"
        ),
        Tile("Trials", f"{own.trials:,}", _each(groups)),
        Tile(
            "Passed",
            f"{100 * held.passed / max(held.trials, 1):.3g} %",
            f"{held.passed:,} of {held.trials:,}{apart}",
        ),
        Tile(
            "Diverged",
            f"{100 * own.diverged / scored:.3g} %",
            f"{own.diverged:,} of {scored:,}",
            tone="bad" if own.diverged else "plain",
        ),
        Tile("Without a score", f"{own.failed:,}", tone="warn" if own.failed else "plain"),
    ]


def campaign_page(chosen: Sequence[Chosen], by: str | None = None) -> Page:
    """Return the page of a campaign, or of several sources side by side; ``by`` as `find_groups` says."""
    notes = [told for own in chosen for told in own.source.unfinished]
    groups = find_groups(chosen, by, notes)
    cut_off = list(_cut_off(groups, chosen))
    warnings = [*cut_off, *different_ground(*_ran(groups))]
    sections = [
        Section("variants-section", "Variants", _variant_blocks(groups, chosen)),
        Section("errors-section", "Errors", _error_blocks(groups, by, notes)),
        Section("consistency-section", "Consistency", _consistency_blocks(groups, notes)),
        Section("detection-section", "Detection", _detection_blocks(groups)),
        Section("communication-section", "Communication", _communication_blocks(groups)),
        Section("origin-section", "Provenance", _origin_tables(chosen)),
    ]
    best = find_best(groups)
    found = compared(groups, best.group if best else None, notes)
    if found is not None:
        told = [Text(best.evidence)] if best and not warnings else []
        blocks = [*told, *comparison_blocks(found, groups)]
        sections.insert(1, Section("comparison-section", "Comparison", blocks))
    word = "INCOMPLETE" if cut_off else "PARTLY FAILED" if Outcomes.of(groups).failed else "DONE"
    return Page(
        title=" and ".join(dict.fromkeys(own.name for own in chosen)),
        kind="Campaign report" if len(chosen) == 1 else "Comparison",
        word=word,
        tone="warn" if word != "DONE" or warnings else "plain",
        headline=_headline(groups, None if warnings else best),
        facts=_facts(groups, chosen),
        tiles=_tiles(groups),
        sections=sections,
        notes=notes,
        warnings=[f"{warning[:1].upper()}{warning[1:]}." for warning in warnings],
    )


def _ran(groups: Sequence[Group]) -> tuple[list[str], list[Mapping[str, Any]]]:
    """Return each variant by name, with the topology that it ran."""
    variants = {group.variant: group for group in groups}.values()
    return [group.variant_name for group in variants], [group.document for group in variants]


def _cut_off(groups: Sequence[Group], chosen: Sequence[Chosen]) -> Iterator[str]:
    """Yield how much there is of each record that breaks off."""
    for variant in dict.fromkeys(group.variant for group in groups):
        own = [group for group in groups if group.variant == variant]
        first, incomplete = own[0], max(group.rows.incomplete for group in own)
        if not incomplete:
            continue
        name = first.variant_name if first.title or first.settings else chosen[variant[0]].name
        told = f"the record of {incomplete} of {first.rows.trials} trials of {name} is incomplete"
        if first.rows.trials == 1:
            steps = int(first.document["steps"])
            there = steps - max(group.rows.most_missing for group in own)
            told = f"the record of {name} is incomplete, {there} of {steps} steps recorded"
        yield f"{told}: its figures are those of what is there"


def _variant_blocks(groups: Sequence[Group], chosen: Sequence[Chosen]) -> list[Block]:
    failures = failure_table(chosen)
    return [variant_table(groups), outcome_figure(groups), *([failures] if failures else [])]


def _error_blocks(groups: Sequence[Group], by: str | None, notes: list[str]) -> list[Block]:
    swept = swept_figure(groups, by)
    return [
        error_table(groups),
        *([swept] if swept else []),
        *pair_figures(groups),
        error_curves(groups, notes),
        trial_spread(groups),
        *_folded([*price_tables(groups), *bound_blocks(groups)]),
    ]


def _consistency_blocks(groups: Sequence[Group], notes: list[str]) -> list[Block]:
    curves = consistency_curves(groups, notes)
    blocks: list[Block] = _folded([consistency_table(groups)])
    if any(len(group.nodes) > 1 for group in groups):
        blocks.append(
            Text(
                "Estimators of one trial follow the same plant: their NEES and NIS are put together before "
                "trials are compared, and the least white of them is named. --by node judges each alone."
            )
        )
    return [*blocks, *([curves] if curves else [])]


def _communication_blocks(groups: Sequence[Group]) -> list[Block]:
    front, apart = pareto_figure(groups), disagreement_figure(groups)
    blocks: list[Block] = [own for own in (front, apart) if own]
    if front is None and len(groups) > 1:
        told = "All fill their slots as often: what a packet buys in error is not to be seen here."
        blocks.insert(0, Text(told))
    return blocks or [Text("There is one group of estimators, and no network in which to disagree.")]


def _origin_tables(chosen: Sequence[Chosen]) -> list[Block]:
    names = told_apart([own.name for own in chosen], [str(own.source.path) for own in chosen])
    return [origin_table(own, name) for own, name in zip(chosen, names, strict=True)]


def _each(groups: Sequence[Group]) -> str:
    """Return how many trials each variant has, where that is the same for all of several."""
    trials = {group.variant: group.rows.trials for group in groups}
    same = len(trials) > 1 and len(set(trials.values())) == 1
    return f"{groups[0].rows.trials:,} of each" if same else ""


def _facts(groups: Sequence[Group], chosen: Sequence[Chosen]) -> str:
    lengths = dict.fromkeys(f"{group.rows.steps:,} steps of {group.period_s:g} s" for group in groups)
    confidence = f"{100 * groups[0].confidence:g} %"
    told = f"{' or '.join(lengths)}; intervals hold with {confidence} confidence over trials."
    fewest = min(group.rows.trials for group in groups)
    few = [_FEW.format(fewest)] if 1 < fewest < ENOUGH else []
    return " ".join(
        [told, *few, *(_choice(own) for own in chosen if len(own.variants) < len(own.source.variants))]
    )


def _choice(own: Chosen) -> str:
    """Return which variants of a campaign are told of."""
    which = f"number {shown(own.variants)}" if own.choice.isdigit() else f"those with {own.choice}"
    return f"Of the {len(own.source.variants)} variants of {own.source.name}, {which}."
