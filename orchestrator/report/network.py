"""The network, drawn: nodes by role, links by loss, what was attacked, and figures at a touch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.graph_drawing import layout
from orchestrator.graph_routes import Point, bends, curve
from orchestrator.report.contents import Figure, Trace, View
from orchestrator.report.recording import Recording
from orchestrator.score.gather import Floats
from orchestrator.score.headline import several
from orchestrator.score.judging import show
from orchestrator.score.link_results import LinkScore
from orchestrator.score.results import NodeScore, Score

LOSS_CLASSES = (
    (0.0, "no loss"),
    (0.05, "up to 5 % lost"),
    (0.1, "5 to 10 % lost"),
    (0.2, "10 to 20 % lost"),
    (1.0, "over 20 % lost"),
)
_WIDTHS = (0.9, 1.3, 1.9, 2.7, 3.6)
_APART = 0.014
_ROLES = {
    "plant": ("square", "$amber/45", 30),
    "sensor": ("circle", "$sky/45", 20),
    "estimator": ("hexagon", "$green/40", 24),
    "controller": ("diamond", "$pink/45", 24),
}


def loss_class(share: float | None) -> int:
    """Return the rank of a loss share among `LOSS_CLASSES`."""
    return next(rank for rank, (bound, _) in enumerate(LOSS_CLASSES) if (share or 0.0) <= bound)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.3g} %"


def _link_text(link: LinkScore) -> str:
    packets = link.traffic
    lines = [
        f"<b>{link.source} to {link.destination}</b>",
        f"{packets.sent} sent, {packets.lost} lost ({_percent(packets.lost_share)})",
    ]
    if packets.attacked or packets.injected:
        lines.append(f"{packets.attacked} attacked, {packets.injected} injected")
    if link.detector is not None:
        judged = link.detector
        lines.append(f"rejected: {judged.true_positive} attacked, {judged.false_positive} genuine")
    return "<br>".join(lines)


def _ratio(mean: float | None, dof: float | None) -> str:
    return show(round(mean / dof, 3)) if mean is not None and dof else "-"


def _node_text(node: NodeScore) -> str:
    errors = ", ".join(
        f"{group} {'-' if error.rmse is None else show(error.rmse)}" for group, error in node.groups.items()
    )
    lines = [
        f"<b>{node.name}</b> {node.method}",
        f"RMSE: {errors}",
        f"NEES by its dof {_ratio(node.nees.mean, node.nees.dof)}, NIS {_ratio(node.nis.mean, node.nis.dof)}",
    ]
    if node.attacked_steps:
        lines.append(f"attacked in {node.attacked_steps} steps")
    if node.divergence_step is not None:
        lines.append(f"diverged at step {node.divergence_step}")
    return "<br>".join(lines)


def _offset(start: Point, end: Point) -> tuple[Point, Point]:
    """Return a link's ends moved to its right, so that the way back is a line of its own."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = math.hypot(dx, dy) or 1.0
    right = (_APART * dy / length, -_APART * dx / length)
    return (start[0] + right[0], start[1] + right[1]), (end[0] + right[0], end[1] + right[1])


def _way(link: LinkScore, places: dict[str, Point], bend: float) -> Floats:
    start, end = _offset(places[link.source], places[link.destination])
    return curve(start, end, bend) if bend else np.array([start, end])


def _line_trace(ways: Sequence[Floats], name: str, colour: str, width: float, dash: str) -> Trace:
    xs: list[float | None] = []
    ys: list[float | None] = []
    for way in ways:
        xs += [*way[:, 0].round(4).tolist(), None]
        ys += [*way[:, 1].round(4).tolist(), None]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": xs,
        "y": ys,
        "name": name,
        "line": {"color": colour, "width": width, "dash": dash},
        "hoverinfo": "skip",
    }


def _arrow_trace(links: Sequence[LinkScore], ways: Sequence[Floats], name: str, colour: str) -> Trace:
    """Return an arrow head on each link, nearer to where it leads, which tells the link's figures."""
    at = [_along(way, 0.66) for way in ways]
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [round(x, 4) for x, _, _ in at],
        "y": [round(y, 4) for _, y, _ in at],
        "marker": {"symbol": "arrow", "size": 10, "angle": [round(a, 1) for _, _, a in at], "color": colour},
        "text": [_link_text(link) for link in links],
        "hoverinfo": "text",
        "legendgroup": name,
        "name": name,
        "showlegend": False,
    }


def _along(way: Floats, share: float) -> tuple[float, float, float]:
    """Return the point at a share of a way, and where it heads there (degrees clockwise from the top)."""
    place = share * (len(way) - 1)
    before = min(int(place), len(way) - 2)
    a, b = way[before], way[before + 1]
    x, y = a + (place - before) * (b - a)
    return float(x), float(y), math.degrees(math.atan2(b[0] - a[0], b[1] - a[1]))


def _is_attacked(link: LinkScore) -> bool:
    return bool(link.traffic.attacked or link.traffic.injected)


def _link_traces(score: Score, places: dict[str, Point]) -> list[Trace]:
    ends = [(link.source, link.destination) for link in score.links]
    attacked = [own for own, link in zip(ends, score.links, strict=True) if _is_attacked(link)]
    bent = bends(ends, places, attacked)
    classes: dict[tuple[str, str, float, str], list[LinkScore]] = {}
    for link in sorted(
        score.links, key=lambda link: (_is_attacked(link), loss_class(link.traffic.lost_share))
    ):
        rank = loss_class(link.traffic.lost_share)
        look = (LOSS_CLASSES[rank][1], f"$loss{rank}", _WIDTHS[rank], "solid")
        if _is_attacked(link):
            look = ("attacked", "$attack", 2.2, "solid")
        classes.setdefault(look, []).append(link)
    traces = []
    for (name, colour, width, dash), links in classes.items():
        ways = [_way(link, places, bent[link.source, link.destination]) for link in links]
        traces.append({**_line_trace(ways, name, colour, width, dash), "legendgroup": name})
        traces.append(_arrow_trace(links, ways, name, colour))
    return traces


def _node_trace(
    role: str, names: Sequence[str], texts: Sequence[str], places: dict[str, Point], marked: set[str]
) -> Trace:
    symbol, colour, size = _ROLES[role]
    crowded = len(names) > 40
    return {
        "type": "scatter",
        "mode": "markers" if crowded else "markers+text",
        "x": [round(places[name][0], 4) for name in names],
        "y": [round(places[name][1], 4) for name in names],
        "text": list(names),
        "textfont": {"size": 11, "color": "$ink"},
        "hovertext": list(texts),
        "hoverinfo": "text",
        "name": role,
        "marker": {
            "symbol": symbol,
            "size": 10 if crowded else size,
            "color": colour,
            "opacity": 1,
            "line": {
                "color": ["$attack" if name in marked else "$ink" for name in names],
                "width": [2.6 if name in marked else 1.0 for name in names],
            },
        },
    }


def _backing(places: dict[str, Point]) -> Trace:
    """Return discs of the page's colour under the nodes, so that no line is seen through them."""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [round(x, 4) for x, _ in places.values()],
        "y": [round(y, 4) for _, y in places.values()],
        "marker": {"size": 20, "color": "$paper"},
        "hoverinfo": "skip",
        "showlegend": False,
    }


def _node_traces(recording: Recording, places: dict[str, Point]) -> list[Trace]:
    plan, score = recording.plan, recording.score
    told = {node.name: _node_text(node) for node in score.nodes}
    sources = {link.source for link in score.links if _is_attacked(link)}
    hit = {node.name for node in score.nodes if node.attacked_steps}
    sensors = [sensor.name for sensor in plan.sensors]
    heard = {name: [own.name for own in plan.estimators if name in own.sensors] for name in sensors}
    sensor_texts = [
        f"<b>{name}</b> {sensor.kind.reference.rpartition(':')[2]}<br>heard by {_few(heard[name])}"
        for name, sensor in zip(sensors, plan.sensors, strict=True)
    ]
    plant_text = f"<b>{plan.plant.name}</b> {plan.plant.kind.reference.rpartition(':')[2]}"
    signals = int(recording.evidence.gathered.attack_beliefs.on.sum())
    if signals:
        plant_text += f"<br>under a signal attack in {several(signals, 'step')}"
    struck = {plan.plant.name} if signals else set()
    traces = [
        _node_trace("plant", [plan.plant.name], [plant_text], places, struck),
        _node_trace("sensor", sensors, sensor_texts, places, sources),
        _node_trace("estimator", recording.names, [told[name] for name in recording.names], places, hit),
    ]
    if plan.controllers:
        texts = [f"<b>{own.name}</b><br>hears {own.estimator}" for own in plan.controllers]
        names = [own.name for own in plan.controllers]
        traces.append(_node_trace("controller", names, texts, places, sources))
    return traces


def _few(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 6 else f"{len(names)} estimators"


def _axis(values: Sequence[float]) -> dict[str, Any]:
    reach = max(map(abs, values), default=1.0) + 0.22
    return {"visible": False, "range": [-reach, reach], "fixedrange": True}


def network_figure(recording: Recording) -> Figure:
    """Return the drawing of the network; touching a node or an arrow head tells its figures."""
    places = dict(layout(recording.plan))
    links = _link_traces(recording.score, places)
    reach = [value for place in places.values() for value in place]
    return Figure(
        name="network",
        title="The network",
        views={(): View([*links, _backing(places), *_node_traces(recording, places)])},
        layout={
            "xaxis": _axis(reach),
            "yaxis": {**_axis(reach), "scaleanchor": "x"},
            "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
            "dragmode": False,
        },
        text="Lines are links, wider and stronger in colour the more packets they lost; an arrow head shows "
        "where a link leads; it bends around nodes that it has nothing to do with. Attacked links, and the "
        "nodes they concern, are marked in orange. Point at a node or an arrow head for its figures.",
        aspect=1.0,
    )
