"""What the channel carried, lost and falsified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.report.contents import Choice, Figure, Table, Trace, View
from orchestrator.report.lines import line, value_axis
from orchestrator.report.recording import CHANNEL_COUNTS, Recording
from orchestrator.report.steps import over_steps, step_shapes
from orchestrator.report.thinning import binned
from orchestrator.score.link_results import LinkScore, Traffic

MOST_NODES = 80
LINK_ROWS = 200

_SHARES = {
    "lost": ("share lost", "$loss4"),
    "attacked": ("share attacked", "$attack"),
    "sent": ("packets sent a step", "$green"),
}


_STAIR = {"width": 1.6, "shape": "hv", "hovertemplate": "%{y:.4g}"}


def rate_figure(recording: Recording, notes: list[str]) -> Figure:
    """Return the packets of all links, step by step."""
    starts, sums, width = binned(recording.counts)
    spans = np.minimum(width, recording.steps - starts)
    rates = {name: sums[row] / spans for row, name in enumerate(CHANNEL_COUNTS)}
    if width > 1:
        notes.append(f"Packets over time are averages over {width} steps each.")
    looks = {
        "sent": "$muted",
        "delivered": "$blue",
        "lost": "$pink",
        "attacked": "$attack",
        "injected": "$brown",
        "refused": "$slate",
    }
    drawn = [name for name in CHANNEL_COUNTS if name in ("sent", "delivered") or rates[name].any()]
    traces = [line(starts, rates[name], name, looks[name], **_STAIR) for name in drawn]
    return Figure(
        name="traffic",
        title="Packets of all links, by step",
        views={(): View(traces, {"shapes": step_shapes(recording, np.zeros(recording.steps, dtype=bool))})},
        layout=over_steps(
            recording,
            {"yaxis": value_axis("packets a step", rangemode="tozero"), "hovermode": "x unified"},
        ),
        text="How often nodes speak, and what becomes of it; an event-triggered sender is often quiet.",
        height=300,
    )


def _value(link: LinkScore, what: str, steps: int) -> float:
    packets = link.traffic
    if what == "sent":
        return packets.sent / steps
    count = packets.lost if what == "lost" else packets.attacked
    return count / packets.sent if packets.sent else np.nan


def _matrix(
    links: Sequence[LinkScore], sources: Sequence[str], destinations: Sequence[str], what: str, steps: int
) -> Trace:
    values = np.full((len(destinations), len(sources)), np.nan)
    texts = [["" for _ in sources] for _ in destinations]
    for link in links:
        if link.source in sources and link.destination in destinations:
            at = destinations.index(link.destination), sources.index(link.source)
            values[at] = _value(link, what, steps)
            packets = link.traffic
            texts[at[0]][at[1]] = (
                f"{link.name}: {packets.sent} sent, {packets.lost} lost, {packets.attacked} attacked"
            )
    label, colour = _SHARES[what]
    return {
        "type": "heatmap",
        "x": list(sources),
        "y": list(destinations),
        "z": [[None if np.isnan(value) else round(float(value), 5) for value in row] for row in values],
        "text": texts,
        "hovertemplate": "%{text}<extra></extra>",
        "hoverongaps": False,
        "colorscale": [[0, f"{colour}/12"], [1, colour]],
        "zmin": 0,
        "zmax": float(np.nanmax(values, initial=0.0 if what == "sent" else 0.2)) or 1.0,
        "xgap": 1,
        "ygap": 1,
        "colorbar": {
            "title": {"text": label, "side": "right", "font": {"size": 12}},
            "thickness": 10,
            "tickformat": ".2~f" if what == "sent" else ".0%",
            "tickfont": {"size": 11},
            "outlinewidth": 0,
        },
    }


def matrix_figure(recording: Recording, notes: list[str]) -> Figure:
    """Return links as a matrix of senders and receivers, coloured by loss, attack or rate."""
    links = recording.score.links
    sources = [name for name in recording.plan.node_names if any(link.source == name for link in links)]
    destinations = [
        name for name in recording.plan.node_names if any(link.destination == name for link in links)
    ]
    if len(sources) > MOST_NODES or len(destinations) > MOST_NODES:
        told = f"of {len(sources)} senders and {len(destinations)} receivers"
        sensors = {sensor.name for sensor in recording.plan.sensors}
        sources = [name for name in sources if name not in sensors][:MOST_NODES] or sources[:MOST_NODES]
        destinations = destinations[:MOST_NODES]
        shown = (
            f"{len(sources)} senders, no sensors," if sources[0] not in sensors else f"{len(sources)} senders"
        )
        notes.append(f"The matrix of links shows {shown} and {len(destinations)} receivers {told}.")
    offered = [what for what in _SHARES if what != "attacked" or recording.score.traffic.attacked]
    views: dict[tuple[str, ...], View] = {
        (what,): View([_matrix(links, sources, destinations, what, recording.steps)]) for what in offered
    }
    return Figure(
        name="links",
        title="Links: senders across, receivers down",
        views=views,
        layout={
            "xaxis": {"title": {"text": "sender"}, "type": "category", "showgrid": False},
            "yaxis": {
                "title": {"text": "receiver"},
                "type": "category",
                "autorange": "reversed",
                "showgrid": False,
            },
        },
        choices=(Choice("Show", [(what, _SHARES[what][0]) for what in offered], "lost"),),
        height=int(np.clip(120 + 16 * len(destinations), 240, 620)),
    )


def _share(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.3g} %"


def _row(name: str, packets: Traffic) -> list[str]:
    burst = "-" if packets.mean_loss_burst is None else f"{packets.mean_loss_burst:.2f}"
    counts = (packets.sent, packets.delivered, packets.lost)
    return [
        name,
        *(f"{count:,}" for count in counts),
        _share(packets.lost_share),
        burst,
        *(f"{count:,}" for count in (packets.attacked, packets.injected, packets.refused)),
    ]


def link_table(recording: Recording, notes: list[str]) -> Table:
    """Return the account of every link, the attacked ones first."""
    links = sorted(recording.score.links, key=lambda link: -(link.traffic.attacked + link.traffic.injected))
    if len(links) > LINK_ROWS:
        notes.append(f"The table of links has {LINK_ROWS} of {len(links)} rows, the attacked ones first.")
    rows = [_row(link.name, link.traffic) for link in links[:LINK_ROWS]]
    return Table(
        caption=f"Packets of each link ({len(links)})",
        columns=(
            *("link", "sent", "delivered", "lost", "share lost", "lost in a row"),
            *("attacked", "injected", "refused"),
        ),
        rows=[*rows, _row("all links", recording.score.traffic)],
        folded=len(links) > 6,
    )
