"""What estimators made of false data on their links: their estimate of the attack beside what was added.

An estimator speaks of an attack on a sensor's packets by diagnostics: ``attack_{sensor}_{i}`` is its estimate
of what is added to component i, and ``attack_variance_{sensor}_{i}`` its error variance. The truth is the
difference between what arrived and what the sensor sent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import count, takewhile

import numpy as np

from bus import keys
from bus.integrity import Gate
from bus.packets import ORACLE, Packet, Vector
from bus.plan import Plan
from channel.contract import ATTACKED, Event
from orchestrator.score.link_results import RecoveredAttack

_Place = tuple[int, int]
"""A link and a step."""
_Said = tuple[Sequence[float], Sequence[float]]
"""An estimate and its variances, which may be missing."""


class FalseDataListener:
    """Takes the messages of a record in any order, and keeps what concerns links with stages on them.

    A packet that arrives in a later step than it was sent in, or beside another one of its sensor, is left
    out: estimators speak of the measurement of their own step.
    """

    def __init__(self, plan: Plan) -> None:
        self._links = {
            (link.source, link.destination): number
            for number, link in enumerate(plan.links)
            if link.stream == keys.MEASUREMENT and link.stages
        }
        self._numbers = {link.name: number for number, link in enumerate(plan.links)}
        self._heard: dict[str, list[str]] = {}
        for source, destination in self._links:
            self._heard.setdefault(destination, []).append(source)
        self.sources = {source for source, _ in self._links}
        self.receivers = {keys.rx(node, keys.CORRECT): node for node in self._heard}
        self._gates = {node: Gate(plan, sources) for node, sources in self._heard.items()}
        self._sent: dict[tuple[str, int], Vector] = {}
        self._inboxes: dict[tuple[str, int], Sequence[Packet]] = {}
        self._attacked: set[_Place] = set()
        self._said: dict[_Place, _Said] = {}

    def take_sent(self, source: str, step: int, packets: Sequence[Packet]) -> None:
        """Keep what one of the ``sources`` sent."""
        if len(packets) == 1:
            self._sent[source, step] = packets[0].values

    def take_inbox(self, node: str, step: int, inbox: Sequence[Packet]) -> None:
        """Keep what arrived at one of the ``receivers``."""
        self._inboxes[node, step] = inbox

    def _received(self, source: str, node: str, step: int) -> Vector | None:
        """Return what arrived of a sensor in its own step, None unless that is one packet that is let in."""
        inbox = self._inboxes.get((node, step), ())
        packets = [packet for packet in inbox if packet.source == source and packet.kind != ORACLE]
        if len(packets) != 1 or packets[0].sent_step != step or not self._gates[node].admits(packets[0]):
            return None
        return packets[0].values

    def take_events(self, step: int, events: Sequence[Event]) -> None:
        """Keep which packets were attacked; a sensor numbers its packets by their steps."""
        for name, _, sequence, action, _ in events:
            if action == ATTACKED and sequence == step:
                self._attacked.add((self._numbers.get(name, -1), step))

    def take_diagnostics(self, node: str, step: int, said: Mapping[str, float]) -> None:
        """Keep what an estimate's diagnostics say of attacks on the estimator's sensors."""
        for source in self._heard.get(node, ()):
            value = _components(said, f"attack_{source}_")
            if value:
                variance = _components(said, f"attack_variance_{source}_")
                self._said[self._links[source, node], step] = value, variance

    def recovered(self, links: int, from_step: int) -> list[RecoveredAttack | None]:
        """Return by link how well the attack was recovered; None where nothing was said or attacked."""
        errors: dict[int, list[float]] = {}
        figures: dict[int, list[float]] = {}
        ends = {number: place for place, number in self._links.items()}
        for place in sorted(self._attacked & self._said.keys()):
            link, step = place
            source, node = ends[link]
            sent, (value, variance) = self._sent.get((source, step)), self._said[place]
            received = self._received(source, node, step)
            if step < from_step or sent is None or received is None:
                continue
            if not len(sent) == len(received) == len(value):
                continue
            error = np.array(value) - (received - sent)
            errors.setdefault(link, []).append(float(error.dot(error)))
            if len(variance) == len(value) and min(variance) > 0.0:
                figures.setdefault(link, []).append(float((error * error / np.array(variance)).mean()))
        return [
            RecoveredAttack(
                packets=len(errors[link]),
                rmse=float(np.sqrt(np.mean(errors[link]))),
                nees_ratio=float(np.mean(figures[link])) if link in figures else None,
            )
            if link in errors
            else None
            for link in range(links)
        ]


def _components(said: Mapping[str, float], prefix: str) -> list[float]:
    """Return the numbers called ``{prefix}0``, ``{prefix}1`` and so on, as far as they go."""
    names = takewhile(said.__contains__, (f"{prefix}{i}" for i in count()))
    return [said[name] for name in names]
