"""Tables of many trials: variants, errors, bounds, detectors, and where it all comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from orchestrator.evidence.chosen import Chosen, shown
from orchestrator.evidence.detectors import Detection
from orchestrator.evidence.figures import efficiency, rmse, sent_rate
from orchestrator.evidence.intervals import Interval, share
from orchestrator.evidence.timing import step_time
from orchestrator.report.contents import Table, Text
from orchestrator.report.groups import Group, Outcomes, state_names

LISTED = 8
"""Most entries of a list that the table of origins names."""


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


def variant_table(groups: Sequence[Group]) -> Table:
    """Return the groups of estimators with what became of their trials."""
    rows = []
    for number, group in enumerate(groups, start=1):
        own = Outcomes.of([group])
        rows.append(
            (
                f"{number}",
                group.name,
                _span(group.nodes),
                f"{own.trials:,}",
                f"{own.failed:,}",
                "-"
                if group.is_twin
                else interval(share(own.passed, own.trials, group.confidence), percent=True),
                interval(share(own.diverged, own.trials - own.failed, group.confidence), percent=True),
                interval(sent_rate(group.rows, group.confidence), percent=True),
            )
        )
    columns = (
        *("", "variant", "estimators", "trials", "without score", "passed", "diverged"),
        "slots with a packet",
    )
    return Table("Variants, with intervals over trials", columns, rows, frozenset({0, 1, 2}))


def _span(nodes: Sequence[str]) -> str:
    return ", ".join(nodes) if len(nodes) <= 3 else f"{nodes[0]} to {nodes[-1]} ({len(nodes)})"


def error_table(groups: Sequence[Group]) -> Table:
    """Return the RMSE of each group in each state group."""
    states = state_names(groups)
    rows = [
        (
            group.name,
            *(interval(rmse(group.rows, state, group.confidence)) for state in states),
            _left_out(group),
        )
        for group in groups
    ]
    columns = ("variant", *("whole state" if state == "state" else state for state in states), "left out")
    return _without_empty_end(Table("RMSE over all scored steps and trials", columns, rows))


def _without_empty_end(table: Table) -> Table:
    """Return a table without its last column, where that is empty."""
    if any(row[-1] for row in table.rows):
        return table
    return replace(table, columns=table.columns[:-1], rows=[row[:-1] for row in table.rows])


def _left_out(group: Group) -> str:
    """Return how many estimators' trials have no finite error, empty for none."""
    diverged = int(np.isfinite(group.rows.scalar("divergence_step")).sum())
    return f"{diverged:,} of {group.rows.trial.size:,} diverged" if diverged else ""


def bound_blocks(groups: Sequence[Group]) -> list[Table | Text]:
    """Return errors by the posterior Cramér-Rao bound, and where it is refused and why."""
    states, rows, reasons = state_names(groups), [], dict[str, int]()
    for group in groups:
        own = [efficiency(group.rows, state, group.from_step, group.confidence) for state in states]
        for reason, count in own[-1].refused.items():
            reasons[reason] = reasons.get(reason, 0) + count
        if own[-1].steps:
            ratios = (interval(part.ratio) for part in own)
            covered = f"{100 * own[-1].steps:.3g} %", ", ".join(own[-1].given)
            rows.append((group.name, *ratios, *covered, _left_out(group)))
    columns = ("variant", *states, "of the steps", "given", "left out")
    title = "RMSE over the posterior Cramér-Rao bound, in the steps in which that is right"
    blocks: list[Table | Text] = []
    if rows:
        blocks.append(_without_empty_end(Table(title, columns, rows, frozenset({0, len(columns) - 2}))))
    if reasons:
        told = "; ".join(f"{reason} ({count:,} rows)" for reason, count in sorted(reasons.items())[:6])
        blocks.append(Text(f"The posterior Cramér-Rao bound is refused where it would be wrong: {told}."))
    return blocks


def detection_table(found: Mapping[str, Detection]) -> Table:
    """Return rates, areas and delays of the detectors."""
    rows = [
        (
            name,
            interval(own.recall, percent=True),
            interval(own.false_alarm_rate, percent=True),
            _between(own.between_false_alarms),
            interval(own.roc.area),
            f"{own.delay.found} of {own.delay.windows}" if own.delay.windows else "-",
            _steps(own.delay.median) if own.delay.windows else "-",
            _steps(own.delay.restricted_mean) if own.delay.windows else "-",
        )
        for name, own in found.items()
    ]
    columns = (
        *("variant", "attacked rejected", "genuine rejected", "genuine by false alarm"),
        *("AUC", "attacks found", "median delay", "mean delay"),
    )
    return Table("Detectors, with intervals over trials", columns, rows)


def _steps(found: Interval) -> str:
    """Return steps for people; an interval of one step says to the step how long it is."""

    def one(value: float) -> str:
        return "never" if np.isinf(value) else figure(value)

    if np.isnan(found.low):
        return one(found.value)
    if found.low == found.high:
        return f"{one(found.value)} (to the step)"
    return f"{one(found.value)} [{one(found.low)}, {one(found.high)}]"


def _between(found: Interval) -> str:
    """Return how many packets there are by false alarm; without any, how many there are at least."""
    if np.isnan(found.low):
        return figure(found.value)
    if np.isinf(found.value):
        return f"none seen: above {found.low:.3g}"
    high = "unbounded" if np.isinf(found.high) else f"{found.high:.3g}"
    return f"{figure(found.value)} [{found.low:.3g}, {high}]"


def failure_table(chosen: Sequence[Chosen]) -> Table | None:
    """Return the trials that came to no score, and why; None when there is none."""
    rows = []
    wanted = ("variant", "trial", "seed", "status", "message")
    for own in chosen:
        table = own.source.read(lambda name: name in wanted, own.variants)
        rows += [
            (own.source.name, row["variant"], row["trial"], row["seed"], row["message"])
            for row in table.to_pylist()
            if row["status"] == "failed"
        ]
    if not rows:
        return None
    columns = ("topology", "variant", "trial", "seed", "why")
    return Table(f"Trials without a score ({len(rows)})", columns, rows[:200], frozenset({0, 4}), folded=True)


def origin_table(chosen: Chosen, name: str) -> Table:
    """Return where a source comes from, under a name for it."""
    source = chosen.source
    facts = dict(source.provenance)
    told = {**facts, **facts.get("versions", {})}
    versions = {key.partition(".")[2]: text for key, text in told.items() if key.startswith("version.")}
    time = step_time(source, *(chosen.variants if len(chosen.variants) == 1 else ()))
    titles = {
        "file": "file",
        "seed": "seed",
        "first_trial": "first trial",
        "trials": "trials",
        "trial": "trial",
        "overrides": "settings",
        "topology_hash": "topology hash",
        "topology_hashes": "topology hashes",
        "git_commit": "commit",
        "machine": "machine",
    }
    rows = [("results", str(source.path)), ("topology", source.name)]
    if chosen.choice:
        rows.append(("variants", shown(chosen.variants)))
    rows += [
        (title, _plain(told[key])) for key, title in titles.items() if told.get(key) not in (None, [], "")
    ]
    rows.append(("versions", ", ".join(f"{name} {text}" for name, text in versions.items())))
    if time.trials:
        rows.append(("time of a step", f"{1e3 * time.p50_s:.3g} ms, 95 % below {1e3 * time.p95_s:.3g} ms"))
    return Table(f"Where {name} comes from", (), rows, frozenset({0, 1}))


def _plain(value: object) -> str:
    if not isinstance(value, list | tuple):
        return str(value)
    more = [f"and {len(value) - LISTED} more"] if len(value) > LISTED else []
    return ", ".join([*map(str, value[:LISTED]), *more])
