"""The tables of a run's messages: which columns each has, and how messages become rows.

One row an estimate, a packet, an account of a link, an act of the channel; no user needs to know the topics.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from bus.messages import ChannelEvents, Estimate, Inbox, Message, Transmission, Truth

COUNTS = ("sent", "lost", "attacked", "delivered", "injected", "duplicated", "refused", "in_flight")
_TIME = {"step": "int64", "t": "float64"}
_IN_PHASE = {**_TIME, "phase": "string", "round": "int64", "link": "string"}
_FIXED: Mapping[str, Mapping[str, str]] = {
    "truth": _TIME,
    "estimates": {
        **_TIME,
        "node": "string",
        "method": "string",
        "refers_to": "int64",
        "diverged": "bool",
        "nis": "float64",
        "nis_dof": "int64",
        "refused": "int64",
    },
    "diagnostics": {**_TIME, "node": "string", "name": "string", "value": "float64"},
    "packets": {
        **_TIME,
        "direction": "string",
        "node": "string",
        "round": "int64",
        "stream": "string",
        "source": "string",
        "sent_step": "int64",
        "sequence": "int64",
        "values": "list.float64",
    },
    "links": {**_IN_PHASE, **dict.fromkeys(COUNTS, "int64")},
    "events": {
        **_IN_PHASE,
        "stage": "string",
        "sequence": "int64",
        "action": "string",
        "magnitude": "float64",
    },
}
RECORDED = tuple(_FIXED)
"""The tables that come from a run's messages."""

_TAKEN = frozenset(
    {"control", "attack", "covariance", *(name for columns in _FIXED.values() for name in columns)}
)


def component_names(groups: Mapping[str, Sequence[int]], size: int) -> list[str]:
    """Return a name for each of the ``size`` components of the state.

    A component is called as its state group is, with its place in the group when there are several:
    ``position``, ``upper_0``. One of no group is ``x3``, and so is one whose name another column has.
    """
    names = [f"x{index}" for index in range(size)]
    for group, indices in reversed(list(groups.items())):
        for place, index in enumerate(indices):
            names[index] = group if len(indices) == 1 else f"{group}_{place}"
    return [
        f"x{index}" if name in _TAKEN or names.count(name) > 1 else name for index, name in enumerate(names)
    ]


def column_types(components: Sequence[str]) -> dict[str, dict[str, str]]:
    """Return the columns of every table with their types; ``list.`` before that of a list's members."""
    state = dict.fromkeys(components, "float64")
    sigma = {f"sigma_{name}": "float64" for name in components}
    more = {
        "truth": {**state, "control": "list.float64", "attack": "list.float64"},
        "estimates": {**state, **sigma, "covariance": "list.float64"},
    }
    return {name: {**fixed, **more.get(name, {})} for name, fixed in _FIXED.items()}


class Rows:
    """The rows of every table, in the making, from messages in the order of a log.

    ``methods`` names the method of each estimator.
    """

    def __init__(self, methods: Mapping[str, str]) -> None:
        self.rows: dict[str, list[Sequence[Any]]] = {name: [] for name in RECORDED}
        self._methods = methods
        self._nothing: list[None] = []

    def take(self, topic: str, message: Message) -> None:
        """Add what a message tells."""
        if isinstance(message, Truth):
            self._nothing = [None] * len(message.state)
            row = (message.step, message.t, *message.state, message.control, message.attack)
            self.rows["truth"].append(row)
        elif isinstance(message, Estimate):
            self._take_estimate(topic.split("/")[1], message)
        elif isinstance(message, Transmission | Inbox):
            self.rows["packets"] += packet_rows(topic, message)
        elif isinstance(message, ChannelEvents):
            phase = topic.split("/")[1]
            self.rows["links"] += link_rows(phase, message)
            self.rows["events"] += event_rows(phase, message)

    def _take_estimate(self, node: str, message: Estimate) -> None:
        begin = (message.step, message.t, node)
        nis = message.nis if message.nis_dof else None
        told = (message.refers_to, message.diverged, nis, message.nis_dof, message.refused)
        state = (*(message.state or self._nothing), *(message.sigma or self._nothing))
        row = (*begin, self._methods[node], *told, *state, message.covariance or None)
        self.rows["estimates"].append(row)
        diagnostics = zip(message.diagnostic_name, message.diagnostic_value, strict=True)
        self.rows["diagnostics"] += [(*begin, *diagnostic) for diagnostic in diagnostics]


def packet_rows(topic: str, message: Transmission | Inbox) -> Iterator[Sequence[Any]]:
    """Yield a row a packet: as it was sent (tx), or as it was received (rx)."""
    direction, node, stream = topic.split("/")
    begin = (message.step, message.t, direction, node, message.round)
    bounds = pairwise([*message.offset, len(message.values)])
    values = [message.values[first:last] for first, last in bounds]
    if isinstance(message, Transmission):
        for sequence, payload in zip(message.sequence, values, strict=True):
            yield (*begin, stream, node, message.step, sequence, payload)
    else:
        packets = zip(message.kind, message.source, message.sent_step, message.sequence, values, strict=True)
        for packet in packets:
            yield (*begin, *packet)


def link_rows(phase: str, message: ChannelEvents) -> Iterator[Sequence[Any]]:
    """Yield a row a link: what it carried in a phase of a step."""
    begin = (message.step, message.t, phase, message.round)
    counts = [getattr(message, name) or [0] * len(message.link) for name in COUNTS]
    for account in zip(message.link, *counts, strict=True):
        yield (*begin, *account)


def event_rows(phase: str, message: ChannelEvents) -> Iterator[Sequence[Any]]:
    """Yield a row an act of the channel in a phase of a step."""
    begin = (message.step, message.t, phase, message.round)
    acts = zip(
        message.event_link,
        message.event_stage,
        message.event_sequence,
        message.event_action,
        message.event_magnitude,
        strict=True,
    )
    for act in acts:
        yield (*begin, *act)
