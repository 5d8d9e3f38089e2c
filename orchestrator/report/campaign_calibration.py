"""Whether announced probabilities of signal attacks came true: reliability diagrams over many trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.evidence.calibration import BINS, Calibration, attack_calibration, speaks_of_attacks
from orchestrator.report.campaign_tables import figure, interval
from orchestrator.report.contents import Block, Figure, Mark, Table, Trace, View
from orchestrator.report.group_pieces import visible
from orchestrator.report.groups import Group
from orchestrator.report.lines import line, value_axis
from orchestrator.report.palette import series_style

_ROOM = 0.03
"""How far the axes of shares go beyond 0 and 1."""


def calibrations(groups: Sequence[Group]) -> dict[str, Calibration]:
    """Return what came true of the probabilities of each group that announces any, by its name."""
    return {
        group.name: attack_calibration(group.rows, group.from_step, confidence=group.confidence)
        for group in groups
        if speaks_of_attacks(group.rows)
    }


def calibration_blocks(groups: Sequence[Group]) -> list[Block]:
    """Return the table and the diagram of all groups that announce probabilities; nothing where none does."""
    found = calibrations(groups)
    return [_table(found), reliability_diagram(found)] if found else []


def _table(found: Mapping[str, Calibration]) -> Table:
    rows = [
        (
            name,
            f"{own.count.sum():,}",
            interval(own.error),
            figure(own.by_chance),
            _verdict(own),
        )
        for name, own in found.items()
    ]
    columns = ("variant", "statements", "calibration error", "by chance alone", "verdict")
    return Table("Probability of a signal attack: is it one?", columns, rows, frozenset({0, 4}))


def _verdict(own: Calibration) -> Mark:
    """Return whether the error is more than chance makes of a calibrated source."""
    if np.isnan(own.error.low):
        return Mark("unknown", "plain")
    return Mark("miscalibrated", "bad") if own.error.low > 0.0 else Mark("calibrated", "good")


def reliability_diagram(found: Mapping[str, Calibration], name: str = "calibration") -> Figure:
    """Return the frequency of attacks over their announced probability, and how often each was announced."""
    whole = np.array([0.0, 1.0])
    traces: list[Trace] = [line(whole, whole, "calibrated", "$line", dash="dash", hoverinfo="skip")]
    for number, (group, own) in enumerate(found.items()):
        traces += _of_group(own, group, number)
    span = [-_ROOM, 1.0 + _ROOM]
    return Figure(
        name=name,
        title="Announced probability against frequency",
        views={(): View(traces)},
        layout={
            "xaxis": value_axis("announced probability of a signal attack", range=span, anchor="y2"),
            "yaxis": value_axis("frequency of an attack", range=span, domain=[0.36, 1.0]),
            "yaxis2": value_axis("statements", domain=[0.0, 0.27], tickformat=".0%", rangemode="tozero"),
            "barmode": "group",
            "bargap": 0.1,
        },
        text=f"In each of {BINS} bins: how often there was an attack when such a probability was announced, "
        "with its interval over trials; below, the share of the statements in the bin. On the dashed line it "
        "is a probability; a curve flatter than the line is too sure of itself, a steeper one too careful.",
        height=520,
    )


def _of_group(own: Calibration, name: str, number: int) -> list[Trace]:
    """Return a group's curve with its intervals, and its bars of how often each bin was used."""
    style, at = series_style(number), np.flatnonzero(own.count)
    value, low, high = (part[at] for part in (own.frequency.value, own.frequency.low, own.frequency.high))
    bars = {
        "type": "data",
        "symmetric": False,
        "array": np.nan_to_num(high - value),
        "arrayminus": np.nan_to_num(value - low),
        "thickness": 1.2,
        "color": style["color"],
    }
    shares = own.count[at] / own.count.sum()
    told = [f"{count:,} statements" for count in own.count[at].tolist()]
    hover = f"{name}<br>announced %{{x:.3f}}: %{{y:.3f}} of %{{customdata}}<extra></extra>"
    curve = line(own.probability[at], value, name, style["color"], dash=style["dash"], error_y=bars)
    return [
        {
            **curve,
            "mode": "lines+markers",
            "marker": {"color": style["color"], "size": 6},
            "customdata": told,
            "hovertemplate": hover,
            "legendgroup": name,
            **visible(number),
        },
        {
            "type": "bar",
            "x": (at + 0.5) / own.count.size,
            "y": shares,
            "name": name,
            "yaxis": "y2",
            "marker": {"color": style["color"]},
            "customdata": told,
            "hovertemplate": f"{name}<br>%{{customdata}}, %{{y:.1%}}<extra></extra>",
            "legendgroup": name,
            "showlegend": False,
            **visible(number),
        },
    ]
