"""What stands under one figure or table of a paper: numbers beside the paper's, curves, links to a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from orchestrator.report.campaign_calibration import reliability_diagram
from orchestrator.report.campaign_tables import figure as as_text
from orchestrator.report.campaign_tables import interval
from orchestrator.report.contents import Block, Figure, Link, Mark, Table, Text, Trace, View
from orchestrator.report.group_pieces import band_traces, points_trace
from orchestrator.report.lines import log_axis, step_axis, value_axis
from orchestrator.reproduction.claims import CALIBRATION_ERROR, Entry, Points, Value
from orchestrator.reproduction.judging import Word, why_open, word_on
from orchestrator.reproduction.measuring import (
    FEWEST,
    Found,
    Results,
    calibration_of,
    number,
    over_what_varies,
    series,
)
from orchestrator.score.gather import Floats

TONES = {
    Word.AGREES: "good",
    Word.AS_ONE_RUN: "good",
    Word.HOLDS: "good",
    Word.DIFFERS: "warn",
    Word.FAILS: "warn",
    Word.OPEN: "plain",
    Word.NOTHING: "plain",
}


_SIDES = ("value", "low", "high")
"""A number and the ends of its interval."""


def run_page_name(entry: Entry) -> str:
    """Return the file, in its campaign's directory, of the report on an entry's single trial."""
    assert entry.run is not None
    return f"variant-{entry.run.variant}-trial-{entry.run.trial}.html"


def blocks_of(entry: Entry, name: str, results: Results, words: Counter[Word]) -> list[Block]:
    """Return what an entry shows; ``name`` begins the names of its figures, ``words`` counts the verdicts."""
    blocks: list[Block] = []
    if entry.values:
        blocks.append(_value_table(entry, results, words))
    announced = {
        value.label: calibration_of(results, value)
        for value in entry.values
        if value.statistic == CALIBRATION_ERROR
    }
    if announced:
        blocks.append(reliability_diagram(announced, f"{name}-reliability"))
    if entry.curves:
        blocks.append(_curves(entry, name, results))
    if entry.points:
        at = [over_what_varies(results, part) for part in entry.points]
        blocks += [_points_figure(entry, name, at), _points_table(entry, at)]
    if entry.run is not None:
        link = Link(
            f"trial {entry.run.trial} of {entry.run.campaign}", f"{entry.run.campaign}/{run_page_name(entry)}"
        )
        row = (link, "truth and estimates, errors, detection, packets, step by step")
        blocks.append(Table("One run, as the paper shows it", ("report", "holds"), [row], frozenset({0, 1})))
    return [*blocks, *([Text(entry.note)] if entry.note else [])]


def _value_table(entry: Entry, results: Results, words: Counter[Word]) -> Table:
    """Return the values beside the paper's, and count the verdicts; without a paper's they are ours alone."""
    is_compared = any(value.paper is not None for value in entry.values)
    rows: list[tuple[object, ...]] = []
    for value in entry.values:
        found = number(results, value)
        word = word_on(value, found)
        words[word] += 1
        ours = (interval(found.number), _range(found), f"{found.trials:,}", _statistic(value))
        why = why_open(value, found) if word is Word.OPEN else ""
        verdict = Mark(f"{word.value}: {why}" if why else word.value, TONES[word])
        beside = (_paper(value), ours[0], verdict, *ours[1:]) if is_compared else ours
        rows.append((value.label, *beside))
    more = ("single runs", "trials", "over trials")
    if is_compared:
        columns = ("", "paper", "ours", "verdict", *more)
        return Table(f"{entry.name}: the paper's and ours", columns, rows, frozenset({0, 1, 3, 6}))
    return Table(f"{entry.name}: ours", ("", "ours", *more), rows, frozenset({0, 4}))


def _paper(value: Value) -> str:
    if value.paper is None:
        return "-"
    return value.paper if isinstance(value.paper, str) else as_text(float(value.paper))


def _range(found: Found) -> str:
    low, high = found.range
    return "-" if np.isnan(low) else f"{as_text(low)} to {as_text(high)}"


def _axes(entry: Entry, values: Sequence[Floats]) -> dict[str, object]:
    title = entry.y_title or "value"
    return log_axis(title, values) if entry.log_y else value_axis(title)


def _curves(entry: Entry, name: str, results: Results) -> Figure:
    traces: list[Trace] = []
    bands = [series(results, curve) for curve in entry.curves]
    for i, (curve, found) in enumerate(zip(entry.curves, bands, strict=True)):
        traces += band_traces(found, curve.label, i)
    periods = {
        float(results.source(curve.campaign).document(curve.variant)["period_s"]) for curve in entry.curves
    }
    layout = {
        "xaxis": step_axis(*periods),
        "yaxis": _axes(entry, [found.value for found in bands]),
        "hovermode": "x unified",
    }
    return Figure(
        f"{name}-curves",
        f"{entry.name}: over the steps",
        {(): View(traces)},
        layout,
        text=f"Over all trials, with 95 % bootstrap bands where there are {FEWEST} trials or more.",
        height=360,
    )


def _points_figure(entry: Entry, name: str, at: Sequence[tuple[Floats, list[Found]]]) -> Figure:
    traces = [
        points_trace(x, [own.number for own in found], part.label, i)
        for i, (part, (x, found)) in enumerate(zip(entry.points, at, strict=True))
    ]
    heights = [np.array([getattr(own.number, side) for own in found]) for _, found in at for side in _SIDES]
    x_title = entry.x_title or (entry.points[0].setting or "")
    x_axis = log_axis(x_title, [x for x, _ in at]) if entry.log_x else value_axis(x_title)
    return Figure(
        f"{name}-points",
        f"{entry.name}: over {x_title}",
        {(): View(traces)},
        {"xaxis": x_axis, "yaxis": _axes(entry, heights)},
        text=f"Each point with its 95 % interval over trials, where there are {FEWEST} or more.",
        height=360,
    )


def _points_table(entry: Entry, at: Sequence[tuple[Floats, list[Found]]]) -> Table:
    every = sorted({float(x) for xs, _ in at for x in xs})
    rows = []
    for part, (xs, found) in zip(entry.points, at, strict=True):
        by_x = dict(zip(xs.tolist(), found, strict=True))
        rows.append(
            (
                f"{part.label} ({_statistic(part)})",
                *(interval(by_x[x].number) if x in by_x else "-" for x in every),
            )
        )
    return Table(f"{entry.name} in numbers", ("", *(f"{x:g}" for x in every)), rows, folded=True)


def _statistic(part: Points | Value) -> str:
    if part.statistic == CALIBRATION_ERROR:
        return "of all together"
    return f"share above {part.above:g}" if part.statistic == "share" else part.statistic
