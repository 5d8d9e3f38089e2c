"""Who is better, by how much, and how sure that is; and what an attack costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.evidence.comparison import Compared, Comparison, Verdict, compare
from orchestrator.evidence.contenders import Contender
from orchestrator.evidence.metrics import label
from orchestrator.evidence.price import find_twins, price
from orchestrator.evidence.remarks import remarks, warnings
from orchestrator.evidence.wording import figure, sentence
from orchestrator.report.contents import Block, Choice, Figure, Mark, Table, Text, Trace, View
from orchestrator.report.groups import Group, state_names
from orchestrator.report.palette import SERIES

CONTENDERS = 8
"""Most groups that are compared two by two."""

_OPEN = (Verdict.UNDECIDED, Verdict.TOO_FEW, Verdict.UNDEFINED)

NAMED = 5
"""Most contenders that the labels of the figure of differences name."""

LETTERS = 20
"""Most letters of the names in the labels of the figure of differences; where one is longer none is named."""

SENTENCES = 5
"""Most verdicts that are told in whole sentences."""


def compared(groups: Sequence[Group], best: Group | None, notes: list[str]) -> Comparison | None:
    """Return the comparison of every two groups in error and consistency; None for a single group.

    Of many groups those are compared that err least, and the ``best`` in any case: attacked ones before their
    unattacked twins.
    """
    if len(groups) < 2:
        return None
    order = sorted(groups, key=lambda group: (group is not best, group.rank))
    chosen = sorted(order[:CONTENDERS], key=lambda group: group.number)
    if len(groups) > CONTENDERS:
        notes.append(f"Of {len(groups)} groups the {CONTENDERS} that err least are compared two by two.")
    states = state_names(groups)
    metrics = [f"rmse.{state}" for state in dict.fromkeys((states[0], "state"))] + ["nees.ratio"]
    return compare([contender_of(group) for group in chosen], metrics, groups[0].confidence)


def contender_of(group: Group) -> Contender:
    """Return a group as somebody to compare."""
    return Contender(group.name, "", group.rows, group.document)


def comparison_blocks(found: Comparison, groups: Sequence[Group]) -> list[Block]:
    """Return a comparison of some of the groups of a page in words, as a figure and as a table."""
    numbers = {group.name: group.number for group in groups}
    own = {contender.name: numbers[contender.name] for contender in found.contenders}
    return [*_words(found), _difference_figure(found, own), _table(found)]


def _words(found: Comparison) -> list[Text]:
    """Return the verdicts that were come to in whole sentences, and how many comparisons came to none."""
    decided = [own for own in found.compared if own.verdict not in _OPEN]
    told = [Text(sentence(own, found)) for own in decided[:SENTENCES]]
    if len(decided) > SENTENCES:
        told.append(Text(f"{len(decided) - SENTENCES} more verdicts stand in the table below."))
    open_ = [own for own in found.compared if own.verdict is Verdict.UNDECIDED]
    few = [own for own in found.compared if own.verdict is Verdict.TOO_FEW]
    if open_:
        told.append(Text(f"{len(open_)} of {len(found.compared)} comparisons show no difference."))
    if few:
        needed = max(own.trials_needed or 0 for own in few)
        told.append(
            Text(
                f"{len(few)} of {len(found.compared)} comparisons have too few trials for any verdict: "
                f"give at least {needed}."
            )
        )
    judged = len(found.compared) - sum(own.verdict is Verdict.UNDEFINED for own in found.compared)
    holm = f"p values are adjusted together for {judged} comparisons (Holm); each interval is for itself."
    notes = [Text(f"Note: {remark}.") for remark in dict.fromkeys(remarks(found))]
    if warnings(found):
        told.insert(0, Text("The warnings at the head of this page hold for every comparison here."))
    return [*told, Text(holm), *notes]


def _verdict(own: Compared) -> Mark:
    tones = {Verdict.FIRST: "good", Verdict.SECOND: "good", Verdict.EQUAL: "plain"}
    names = {Verdict.FIRST: f"{own.first} is better", Verdict.SECOND: f"{own.second} is better"}
    if own.verdict in names and own.within_margin:
        return Mark(f"{names[own.verdict]}, hardly", "plain")
    return Mark(names.get(own.verdict, own.verdict.value), tones.get(own.verdict, "plain"))


def _table(found: Comparison) -> Table:
    rows = [
        (
            label(own.metric),
            own.first,
            own.second,
            _shift(own),
            "-" if not np.isfinite(own.relative) else f"{100 * own.relative:+.1f} %",
            "< 0.0001" if own.p_adjusted < 1e-4 else f"{own.p_adjusted:.2g}",
            f"{own.difference.effect:+.2f}",
            _trials(own),
            _verdict(own),
        )
        for own in found.compared
        if own.verdict is not Verdict.UNDEFINED
    ]
    columns = (
        *("metric", "first", "second", "first less second", "relative"),
        *("p (Holm)", "effect", "trials", "verdict"),
    )
    title = f"Every two, with {100 * found.confidence:g} % intervals"
    return Table(title, columns, rows, frozenset({0, 1, 2, 8}), folded=len(rows) > 12)


def _shift(own: Compared) -> str:
    """Return a difference with its interval, where there are enough trials for one; else two means."""
    shift = own.difference.shift
    if not own.difference.is_shift:
        return f"means {' and '.join(map(figure, own.difference.means))}"
    if not np.isfinite([shift.low, shift.high]).any():
        return figure(shift.value)
    return f"{figure(shift.value)} [{figure(shift.low)}, {figure(shift.high)}]"


def _trials(own: Compared) -> str:
    first, second = own.difference.sizes
    told = f"{first:,} common" if own.difference.paired else f"{first:,}, {second:,} unpaired"
    infinite = own.difference.infinite
    return f"{told}, infinite {infinite[0]:,} and {infinite[1]:,}" if any(infinite) else told


def _difference_figure(found: Comparison, numbers: Mapping[str, int]) -> Figure:
    """Return all differences with their intervals, one metric at a time."""
    views: dict[tuple[str, ...], View] = {}
    for metric in found.metrics:
        own = [item for item in found.compared if item.metric == metric]
        own = [item for item in own if np.isfinite(item.difference.shift.value) and item.difference.is_shift]
        axis = {"tickvals": list(range(len(own))), "ticktext": [_pair(item, numbers) for item in own]}
        across = {"title": {"text": f"{label(metric)}: first less second"}, "range": _reach(own)}
        views[(metric,)] = View([_difference_trace(own)], {"xaxis": across, "yaxis": axis})
    most = max(len(view.traces[0]["y"]) for view in views.values())
    zero = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": 0, "x1": 0, "layer": "below"}
    return Figure(
        name="differences",
        title="Differences with their intervals",
        views=views,
        layout={
            "xaxis": {
                "zeroline": False,
                "tickangle": 0,
                "nticks": 6,
            },
            "yaxis": {"autorange": "reversed", "zeroline": False},
            "shapes": [{**zero, "line": {"color": "$muted", "width": 1.4, "dash": "dot"}}],
            "margin": {"l": 30, "r": 18, "t": 10, "b": 44},
        },
        choices=(Choice("Metric", [(metric, label(metric)) for metric in found.metrics], found.metrics[0]),),
        text="The median difference, trial by trial where there are common ones, by the numbers of the table "
        "of variants. Where the bar does not reach zero (dotted), the ranks favour one; the verdicts also "
        "count how much was compared at once, and who is infinite more often, which no bar shows. Left out "
        "is what no shift describes.",
        height=110 + (34 if _are_named(numbers) else 24) * most,
    )


def _pair(own: Compared, numbers: Mapping[str, int]) -> str:
    """Return a label for two contenders: their numbers in the table of variants, and few short names."""
    if not _are_named(numbers):
        return f"{numbers[own.first]} less {numbers[own.second]}"
    return f"{numbers[own.first]} {own.first}<br>less {numbers[own.second]} {own.second}"


def _are_named(numbers: Mapping[str, int]) -> bool:
    return len(numbers) <= NAMED and max(map(len, numbers)) <= LETTERS


def _difference_trace(own: Sequence[Compared]) -> Trace:
    shifts = [item.difference.shift for item in own]
    reach = [(_finite(shift.high - shift.value), _finite(shift.value - shift.low)) for shift in shifts]
    decided = {Verdict.FIRST, Verdict.SECOND, Verdict.LOWER, Verdict.HIGHER}
    return {
        "type": "scatter",
        "mode": "markers",
        "x": np.array([shift.value for shift in shifts]),
        "y": np.arange(len(own)),
        "error_x": {
            "type": "data",
            "symmetric": False,
            "array": [high for high, _ in reach],
            "arrayminus": [low for _, low in reach],
            "color": "$blue",
            "thickness": 1.8,
        },
        "marker": {
            "size": 10,
            "color": [f"${SERIES[0]}" if item.verdict in decided else "$paper" for item in own],
            "line": {"color": "$blue", "width": 2},
        },
        "text": [f"{item.first}<br>less {item.second}" for item in own],
        "customdata": [item.verdict.value for item in own],
        "hovertemplate": "%{text}<br>%{x:.4g}: %{customdata}<extra></extra>",
        "showlegend": False,
    }


def _reach(own: Sequence[Compared]) -> list[float]:
    """Return the range of the axis: all differences with their intervals, and zero, with room beside them."""
    shifts = [item.difference.shift for item in own]
    ends = [end for shift in shifts for end in (shift.low, shift.value, shift.high) if np.isfinite(end)]
    low, high = min([0.0, *ends]), max([0.0, *ends])
    room = 0.06 * (high - low) or 1.0
    return [low - room, high + room]


def _finite(value: float) -> float:
    return float(value) if np.isfinite(value) else 0.0


def price_tables(groups: Sequence[Group]) -> list[Table]:
    """Return what attacks cost beside the unattacked twin, where a campaign holds one."""
    metric = f"rmse.{state_names(groups)[0]}"
    rows = []
    for attacked in groups:
        twin = next((own for own in groups if _is_twin(own, attacked)), None)
        if twin is None:
            continue
        own = price(attacked.rows, twin.rows, metric, attacked.confidence)
        shift = own.difference.shift
        rows.append(
            (
                attacked.name,
                figure(own.unattacked),
                figure(own.attacked),
                f"{figure(shift.value)} [{figure(shift.low)}, {figure(shift.high)}]",
                "-" if not np.isfinite(own.relative) else f"{100 * own.relative:+.1f} %",
            )
        )
    if not rows:
        return []
    columns = ("variant", "without the attack", "with it", "price", "relative")
    return [Table(f"Price of the attack in {metric}, trial by trial", columns, rows)]


def _is_twin(one: Group, attacked: Group) -> bool:
    """Return whether a group is what another would have been without its attacks."""
    return one.nodes == attacked.nodes and 1 in find_twins([one.document, attacked.document])
