"""The report of many trials: of a campaign, or of several runs and campaigns side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.evidence.detectors import Detection
from orchestrator.evidence.figures import consistency, efficiency, rmse, sent_rate
from orchestrator.evidence.intervals import Interval, share
from orchestrator.evidence.sources import Source
from orchestrator.report.campaign import (
    consistency_curves,
    disagreement_figure,
    error_curves,
    outcome_figure,
    pareto_figure,
    trial_spread,
)
from orchestrator.report.contents import Figure, Mark, Page, Section, Table, Text, Tile
from orchestrator.report.delays import detections, operating_figure, roc_curves, survival_figure
from orchestrator.report.groups import Group, find_groups

_TONES = {"consistent": "good", "overconfident": "bad", "conservative": "warn", "unknown": "plain"}


def figure(value: float) -> str:
    """Return a number for people."""
    return "-" if np.isnan(value) else "unbounded" if np.isinf(value) else f"{value:.4g}"


def interval(found: Interval, percent: bool = False) -> str:
    """Return a figure with its interval for people."""
    scale, unit = (100.0, " %") if percent else (1.0, "")
    if np.isnan(found.value):
        return "-"
    if np.isnan(found.low):
        return f"{scale * found.value:.4g}{unit}"
    return f"{scale * found.value:.4g}{unit} [{scale * found.low:.3g}, {scale * found.high:.3g}]"


def _variant_table(groups: Sequence[Group]) -> Table:
    states = groups[0].groups
    rows = []
    for group in groups:
        passed, trials = group.passed()
        diverged, scored = group.diverged()
        rows.append(
            (
                group.name,
                f"{trials}",
                f"{int(group.rows.failed.sum())}",
                interval(share(passed, trials), percent=True),
                interval(share(diverged, scored), percent=True),
                *(interval(rmse(group.rows, state, group.confidence)) for state in states),
                interval(sent_rate(group.rows), percent=True),
            )
        )
    columns = (
        *("variant", "trials", "without score", "passed", "diverged"),
        *(f"RMSE {state}" for state in states),
        "slots with a packet",
    )
    return Table("Variants, with intervals over trials", columns, rows)


def _consistency_table(groups: Sequence[Group]) -> Table:
    rows = []
    for group in groups:
        found = consistency(group.rows, group.from_step, group.confidence)
        for what, split in (("NEES", found.nees), ("NIS", found.nis)):
            own = split.all
            if np.isnan(own.ratio):
                continue
            bounds = "-" if np.isnan(own.low) else f"{own.low:.3f} to {own.high:.3f}"
            rows.append(
                (
                    group.name,
                    what,
                    figure(own.ratio),
                    bounds,
                    Mark(own.judgement, _TONES[own.judgement]),
                    figure(split.attacked.ratio),
                    figure(split.unattacked.ratio),
                    _white(found.whiteness.all.p_value) if what == "NIS" else "-",
                )
            )
    columns = ("variant", "figure", "by its dof", "if consistent", "verdict", "under attack", "else", "white")
    return Table("Consistency over all steps", columns, rows, frozenset({0, 1}))


def _white(p_value: float) -> str:
    if np.isnan(p_value):
        return "-"
    return f"{'yes' if p_value >= 0.05 else 'no'} (p {p_value:.2g})"


def _bound_table(groups: Sequence[Group]) -> Table | None:
    states, rows = groups[0].groups, []
    for group in groups:
        own = [efficiency(group.rows, state, group.from_step, group.confidence) for state in states]
        refused = "; ".join(f"{reason} ({count} rows)" for reason, count in own[-1].refused.items())
        rows.append(
            (
                group.name,
                *(interval(part.ratio) for part in own),
                f"{100 * own[-1].steps:.3g} %",
                ", ".join(own[-1].given),
                refused,
            )
        )
    columns = ("variant", *(f"{state}" for state in states), "of the steps", "given", "refused because")
    words = frozenset({0, len(columns) - 2, len(columns) - 1})
    return Table("RMSE by the posterior Cramér-Rao bound, where that is right", columns, rows, words)


def _detection_table(found: Mapping[str, Detection]) -> Table:
    rows = [
        (
            name,
            interval(own.recall, percent=True),
            interval(own.false_alarm_rate, percent=True),
            figure(own.between_false_alarms),
            interval(own.roc.area),
            f"{own.delay.found} of {own.delay.windows}" if own.delay.windows else "-",
            _steps(own.delay.median) if own.delay.windows else "-",
        )
        for name, own in found.items()
    ]
    columns = (
        *("variant", "attacked rejected", "genuine rejected", "packets between false alarms"),
        *("AUC", "attacks found", "median delay"),
    )
    return Table("Detectors, with intervals over trials", columns, rows)


def _steps(found: Interval) -> str:
    def one(value: float) -> str:
        return "never" if np.isinf(value) else figure(value)

    return (
        one(found.value)
        if np.isnan(found.low)
        else f"{one(found.value)} [{one(found.low)}, {one(found.high)}]"
    )


def _failure_table(groups: Sequence[Group], sources: Sequence[Source]) -> Table | None:
    rows = []
    for source in sources:
        table = source.table.select(["variant", "trial", "seed", "status", "message"])
        rows += [
            (source.name, row["variant"], row["trial"], row["seed"], row["message"])
            for row in table.to_pylist()
            if row["status"] == "failed"
        ]
    if not rows:
        return None
    columns = ("topology", "variant", "trial", "seed", "why")
    return Table(f"Trials without a score ({len(rows)})", columns, rows[:200], frozenset({0, 4}), folded=True)


def _origin_table(source: Source) -> Table:
    facts = dict(source.provenance)
    versions = facts.pop("versions", {}) or {key: text for key, text in facts.items() if "version." in key}
    named = ", ".join(f"{key.removeprefix('version.')} {text}" for key, text in versions.items())
    rows = [
        ("results", str(source.path)),
        ("topology", source.name),
        *(
            (title, _plain(facts[key]))
            for key, title in (
                *(("file", "file"), ("seed", "seed"), ("first_trial", "first trial"), ("trials", "trials")),
                *(("trial", "trial"), ("overrides", "settings"), ("topology_hash", "topology hash")),
                *(("topology_hashes", "topology hashes"), ("git_commit", "commit")),
            )
            if key in facts
        ),
        ("versions", named),
    ]
    return Table(f"Where {source.name} comes from", (), rows, frozenset({0, 1}))


def _plain(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def _detection_blocks(found: Mapping[str, Detection]) -> list[Figure | Table | Text]:
    if not found:
        return [Text("No estimator judged any packet: there is no detector to report on.")]
    figures = [roc_curves(found), survival_figure(found), operating_figure(found)]
    blocks: list[Figure | Table | Text] = [_detection_table(found), *(own for own in figures if own)]
    if figures[0] is None:
        blocks.append(Text("There is no ROC: it needs both attacked and genuine packets with a verdict."))
    return blocks


def _headline(groups: Sequence[Group]) -> str:
    """Return in a sentence what became of the trials, and who erred least."""
    passed = sum(group.passed()[0] for group in groups)
    trials = sum(group.passed()[1] for group in groups)
    diverged = sum(group.diverged()[0] for group in groups)
    told = f"All that was expected held in {passed:,} of {trials:,} trials"
    told += f"; {diverged:,} diverged" if diverged else "; none diverged"
    if len(groups) < 2:
        return f"{told}."
    state = groups[0].groups[0]
    errors = {group.name: rmse(group.rows, state, group.confidence) for group in groups}
    known = {name: own for name, own in errors.items() if np.isfinite(own.value)}
    if not known:
        return f"{told}."
    best = min(known, key=lambda name: known[name].value)
    return f"{told}. Smallest RMSE of {state}: {best}, {interval(known[best])}."


def _tiles(groups: Sequence[Group]) -> list[Tile]:
    trials = sum(group.rows.trials for group in groups)
    failed = sum(int(group.rows.failed.sum()) for group in groups)
    passed = sum(group.passed()[0] for group in groups)
    diverged = sum(group.diverged()[0] for group in groups)
    scored = max(trials - failed, 1)
    return [
        Tile("Variants and methods", f"{len(groups)}"),
        Tile("Trials", f"{trials:,}", "of all of these"),
        Tile("Passed", f"{100 * passed / max(trials, 1):.3g} %", f"{passed:,} of {trials:,}"),
        Tile(
            "Diverged",
            f"{100 * diverged / scored:.3g} %",
            f"{diverged:,} of {scored:,}",
            tone="bad" if diverged else "plain",
        ),
        Tile("Without a score", f"{failed:,}", tone="warn" if failed else "plain"),
    ]


def campaign_page(sources: Sequence[Source]) -> Page:
    """Return the page of a campaign, or of several sources side by side."""
    groups, notes = find_groups(sources), list[str]()
    found = detections(groups)
    failures, apart = _failure_table(groups, sources), disagreement_figure(groups)
    curves, pareto, bound = consistency_curves(groups, notes), pareto_figure(groups), _bound_table(groups)
    sections = [
        Section(
            "variants-section",
            "Variants",
            [_variant_table(groups), outcome_figure(groups), *([failures] if failures else [])],
        ),
        Section(
            "errors-section",
            "Errors",
            [error_curves(groups, notes), trial_spread(groups), *([bound] if bound else [])],
        ),
        Section(
            "consistency-section",
            "Consistency",
            [_consistency_table(groups), *([curves] if curves else [])],
        ),
        Section("detection-section", "Detection", _detection_blocks(found)),
        Section(
            "communication-section",
            "Communication",
            [
                *([pareto] if pareto else []),
                *([apart] if apart else []),
                *([] if pareto or apart else [Text("There is one variant, and no network to disagree.")]),
            ],
        ),
        Section("origin-section", "Provenance", [_origin_table(source) for source in sources]),
    ]
    failed = any(bool(group.rows.failed.any()) for group in groups)
    names = list(dict.fromkeys(source.name for source in sources))
    return Page(
        title=" and ".join(names),
        kind="Campaign report" if len(sources) == 1 else "Comparison",
        word="PARTLY FAILED" if failed else "DONE",
        tone="warn" if failed else "plain",
        headline=_headline(groups),
        facts=_facts(groups),
        tiles=_tiles(groups),
        sections=sections,
        notes=notes,
    )


def _facts(groups: Sequence[Group]) -> str:
    steps = sorted({group.rows.steps for group in groups})
    return (
        f"{' or '.join(f'{count:,}' for count in steps)} steps of {groups[0].period_s:g} s; "
        f"intervals hold with {100 * groups[0].confidence:g} % confidence over trials."
    )
