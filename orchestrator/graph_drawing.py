"""Draws a network: plant, sensors, estimators, and the links with what stands on them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bus.extras import installing
from bus.keys import EXCHANGE
from bus.plan import LinkPlan, Plan
from orchestrator.errors import InputError
from orchestrator.graph_routes import Ends, Point, bends

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LOSSLESS = frozenset({"perfect", "channel.impairments.perfect:Perfect"})
_COLOURS = {
    "plant": "#f2c14e",
    "sensor": "#8ecae6",
    "estimator": "#d8e2dc",
    "controller": "#cdb4db",
    "link": "#8d99ae",
    "attack": "#c1121f",
}


_HALF_WIDTH = 1.9


class DrawingError(InputError):
    """The network cannot be drawn; the text tells the cure."""


@dataclass(frozen=True)
class DrawnLink:
    """A line of the drawing: a link, or a pair of links in both directions."""

    source: str
    destination: str
    both_ways: bool
    attacked: bool
    lossy: bool

    @property
    def ends(self) -> Ends:
        """From where to where it leads."""
        return self.source, self.destination


def drawn_links(plan: Plan) -> list[DrawnLink]:
    """Return the lines of the drawing; links in both directions are one, if the same is done to both."""
    purposes = {stage.label: stage for stage in plan.stages}
    marks: dict[tuple[str, str], tuple[bool, bool]] = {}
    for link in plan.links:
        stages = [purposes[label] for label in link.stages]
        attacked = any(stage.purpose.startswith("attack/") for stage in stages)
        lossy = any(
            stage.purpose.startswith("channel/") and stage.kind.reference not in _LOSSLESS for stage in stages
        )
        marks[link.source, link.destination] = attacked, lossy
    lines = []
    for (source, destination), mark in marks.items():
        back = marks.get((destination, source))
        if back != mark or source < destination:
            lines.append(DrawnLink(source, destination, back == mark, *mark))
    return lines


def layout(plan: Plan) -> dict[str, Point]:
    """Return the places of all nodes.

    Estimators stand on a ring, linked ones near one another where the graph allows; those that hear every
    sensor in its middle. Each sensor stands outside the first on the ring that listens to it, and the plant
    in a corner, a controller below it.
    """
    hears_all = {own.name: len(own.sensors) == len(plan.sensors) for own in plan.estimators}
    middle = [name for name in hears_all if hears_all[name]] if not all(hears_all.values()) else []
    ring = _around([name for name in hears_all if name not in middle], plan.links_of(EXCHANGE))
    places = {plan.plant.name: (-1.35, 1.35), **_circle(0.3 if len(middle) > 1 else 0.0, middle)}
    places.update(_circle(1.0 if len(ring) > 1 else 0.0, ring))
    turn = {name: index / len(ring) for index, name in enumerate(ring)}
    for estimator in plan.estimators:
        own = (
            [sensor for sensor in estimator.sensors if sensor not in places] if estimator.name in turn else []
        )
        if len(ring) > 1:
            own_places = {
                name: _at(1.32 + 0.16 * rank, turn[estimator.name]) for rank, name in enumerate(own)
            }
        else:
            own_places = _circle(1.0, own, 0.5)
        places.update(own_places)
    places.update(
        {own.name: (-1.35, 1.35 - 0.7 * number) for number, own in enumerate(plan.controllers, start=1)}
    )
    return {**_circle(1.62, [own.name for own in plan.sensors if own.name not in places], 0.5), **places}


def _circle(radius: float, names: Sequence[str], shift: float = 0.0) -> dict[str, Point]:
    return {name: _at(radius, (index + shift) / len(names)) for index, name in enumerate(names)}


def _at(radius: float, turn: float) -> Point:
    """Return the point at a radius, so many turns clockwise from the top."""
    return radius * math.sin(2.0 * math.pi * turn), radius * math.cos(2.0 * math.pi * turn)


def _around(names: Sequence[str], links: Sequence[LinkPlan]) -> list[str]:
    """Return the names in an order in which linked ones tend to stand together: by the graph's slow modes."""
    import numpy as np

    index = {name: i for i, name in enumerate(names)}
    if len(names) < 4 or not links:
        return list(names)
    laplacian = np.zeros((len(names), len(names)))
    for link in links:
        if link.source in index and link.destination in index:
            a, b = index[link.source], index[link.destination]
            laplacian[a, b] = laplacian[b, a] = -1.0
    linked = laplacian.min(axis=1) < 0.0
    np.fill_diagonal(laplacian, -laplacian.sum(axis=1))
    _, modes = np.linalg.eigh(laplacian[np.ix_(linked, linked)])
    turns = iter(np.arctan2(modes[:, 2], modes[:, 1]).round(9).tolist()) if modes.shape[1] > 2 else iter(())
    turn = {name: next(turns, 0.0) for name in names if linked[index[name]]}
    return sorted(names, key=lambda name: (turn.get(name, math.inf), index[name]))


def draw(plan: Plan, out: Path) -> None:
    """Draw a plan's network into a file; its ending says how: svg, png or pdf. Raises `DrawingError`."""
    try:
        from matplotlib import rc_context
    except ImportError:
        raise DrawingError(f"drawing needs matplotlib: {installing('draw')}") from None
    if out.suffix.lower() not in (".svg", ".png", ".pdf"):
        raise DrawingError(f"{out}: the ending '{out.suffix}' is not .svg, .png or .pdf")
    figure = drawing(plan)
    try:
        with rc_context({"svg.hashsalt": plan.name}):
            figure.savefig(out, dpi=150, metadata={"Date": None} if out.suffix.lower() == ".svg" else None)
    except OSError as error:
        raise DrawingError(f"{out} cannot be written: {error.strerror}") from None


def drawing(plan: Plan) -> Figure:
    """Return the drawing of a plan's network.

    Lines between estimators are exchange links, with an arrow head where they lead one way only; a sensor's
    line leads to who listens to it. A line bends around nodes on its way. Red is attacked in some step,
    dashed is lossy; the plant is ringed in red where a signal attacks it.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    axes.set_xlim(-_HALF_WIDTH, _HALF_WIDTH)
    axes.set_ylim(-_HALF_WIDTH, _HALF_WIDTH)
    axes.set_axis_off()
    axes.set_title(plan.name)
    places = layout(plan)
    links = drawn_links(plan)
    attacked = [link.ends for link in links if link.attacked]
    ways = bends([link.ends for link in links], places, attacked)
    for link in links:
        _draw_link(axes, link, places, ways[link.ends])
    _draw_nodes(axes, plan, places)
    _draw_legend(axes)
    return figure


def _draw_link(axes: Axes, link: DrawnLink, places: Mapping[str, Point], bend: float) -> None:
    colour = _COLOURS["attack"] if link.attacked else _COLOURS["link"]
    axes.annotate(
        "",
        xy=places[link.destination],
        xytext=places[link.source],
        zorder=2 if link.attacked else 1,
        arrowprops={
            "arrowstyle": "-" if link.both_ways else "-|>",
            "connectionstyle": f"arc3,rad={bend}",
            "color": colour,
            "linestyle": (0, (5, 3)) if link.lossy else "solid",
            "linewidth": 2.2 if link.attacked else 1.0,
            "shrinkA": 11.0,
            "shrinkB": 11.0,
        },
    )


def _draw_nodes(axes: Axes, plan: Plan, places: Mapping[str, Point]) -> None:
    kinds = {
        plan.plant.name: "plant",
        **{sensor.name: "sensor" for sensor in plan.sensors},
        **{estimator.name: "estimator" for estimator in plan.estimators},
        **{controller.name: "controller" for controller in plan.controllers},
    }
    shapes = {"plant": "s", "sensor": "o", "estimator": "h", "controller": "D"}
    for role, shape in shapes.items():
        names = [name for name in places if kinds[name] == role]
        xs, ys = [places[name][0] for name in names], [places[name][1] for name in names]
        size = 900 if role == "plant" else 420
        ringed = role == "plant" and plan.signals
        edge, width = (_COLOURS["attack"], 3.0) if ringed else ("#22223b", 1.5)
        axes.scatter(
            xs, ys, s=size, marker=shape, c=_COLOURS[role], edgecolors=edge, linewidths=width, zorder=3
        )
    for name, place in places.items():
        axes.annotate(name, place, ha="center", va="center", fontsize=8, zorder=4)
    x, y = places[plan.plant.name]
    measured = "measured by every sensor" if plan.sensors else ""
    axes.annotate(measured, (x, y + 0.14), ha="center", va="bottom", fontsize=7, color="#4a4e69")


def _draw_legend(axes: Axes) -> None:
    from matplotlib.lines import Line2D

    lines = [
        Line2D([], [], color=_COLOURS["link"], label="link"),
        Line2D([], [], color=_COLOURS["link"], linestyle=(0, (5, 3)), label="lossy link"),
        Line2D([], [], color=_COLOURS["attack"], linewidth=2.2, label="attacked link or plant"),
    ]
    axes.legend(handles=lines, loc="lower right", frameon=False, fontsize=8)
