"""What a paper's figures and tables show, and where in our campaigns to look: ``[[figure]]`` of a list.

An entry holds `values` (numbers to set beside the paper's), `curves` (series over steps), `points` (one
figure over something that varies), or a `run` (one trial's own report); or it says why it is ``missing``.
What an entry says of campaign, variant, node, metric and statistic holds for its parts that do not say it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import msgspec

from orchestrator.reproduction.errors import ReproduceError

Statistic = Literal["median", "mean", "rms", "max", "share", "calibration_error"]
"""Of a metric's values, one a trial: ``share`` is that of the trials above ``above``.

``calibration_error`` is that of a series of probabilities, over all trials together.
"""

CALIBRATION_ERROR: Statistic = "calibration_error"


Number = Annotated[int, msgspec.Meta(ge=0)]
"""That of a variant or a trial."""


class _Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a list says; keys that it does not know are refused."""


class Place(_Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where a metric is found: a campaign, one of its variants, and the estimators, ``e4`` or ``e1..e8``."""

    campaign: str = ""
    variant: Number = 0
    node: str | list[str] = "*"
    metric: str = ""

    @property
    def nodes(self) -> Sequence[str]:
        """The patterns of names."""
        return [self.node] if isinstance(self.node, str) else self.node


class Value(Place, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A number; ``paper`` is what the paper says, a number or words, and the bounds are how to read words.

    ``over`` names what each trial's value is divided by, in the same trial.
    """

    label: str
    statistic: Statistic = "median"
    above: float = 0.0
    over: Place | None = None
    paper: float | str | None = None
    at_most: float | None = None
    at_least: float | None = None


class Curve(Place, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A list column of the results over the steps: an error as its RMS over trials, others as their mean."""

    label: str


class Points(Place, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A metric over what varies: variants by a ``setting``, or ``each`` of some estimators at its ``x``."""

    label: str
    statistic: Statistic = "median"
    above: float = 0.0
    setting: str | None = None
    each: list[str] | None = None
    x: list[float] | None = None


class Trial(_Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One trial of a campaign, to be shown by itself."""

    campaign: str = ""
    variant: Number = 0
    trial: Number = 0


class Entry(_Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A figure or table of the paper, or a claim of it."""

    name: str
    about: str
    note: str = ""
    values: list[Value] = []
    curves: list[Curve] = []
    points: list[Points] = []
    run: Trial | None = None
    missing: str = ""
    x_title: str = ""
    y_title: str = ""
    log_x: bool = False
    log_y: bool = False

    @property
    def campaigns(self) -> list[str]:
        """The campaigns that it needs."""
        parts: list[Place | Trial] = [*self.values, *self.curves, *self.points]
        parts += [value.over for value in self.values if value.over is not None]
        parts += [self.run] if self.run else []
        return list(dict.fromkeys(part.campaign for part in parts))


_INHERITED = ("campaign", "variant", "node", "metric", "statistic")
_PARTS: dict[str, type[_Part]] = {"values": Value, "curves": Curve, "points": Points}


def read_entries(where: str, listed: Sequence[Any]) -> list[Entry]:
    """Return the entries of a list; raises `ReproduceError` that names ``where`` and the place in it."""
    entries: list[Entry] = []
    for number, one in enumerate(listed, start=1):
        named = f"'{one['name']}'" if isinstance(one, dict) and "name" in one else f"number {number}"
        place = f"{where}: [[figure]] {named}"
        if not isinstance(one, dict):
            raise ReproduceError(f"{place} is no table; write [[figure]] and its keys below")
        try:
            entry = msgspec.convert(_with_what_holds_for_all(one), Entry)
        except msgspec.ValidationError as error:
            raise ReproduceError(f"{place}: {error}".replace("`$.", "`")) from error
        _check(place, entry)
        entries.append(entry)
    names = [entry.name for entry in entries]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ReproduceError(f"{where}: two [[figure]] are called '{twice}'; give each a name of its own")
    return entries


def _with_what_holds_for_all(one: dict[str, Any]) -> dict[str, Any]:
    """Return an entry whose parts say for themselves what it says for all of them."""
    shared = {key: one[key] for key in _INHERITED if key in one}
    own = {key: value for key, value in one.items() if key not in _INHERITED}
    for key, kind in _PARTS.items():
        if isinstance(own.get(key), list):
            known = {name: value for name, value in shared.items() if name in kind.__struct_fields__}
            own[key] = [known | part if isinstance(part, dict) else part for part in own[key]]
    for part in own.get("values", ()):
        if isinstance(part, dict) and isinstance(part.get("over"), dict):
            inherited = {name: part[name] for name in _INHERITED[:-1] if name in part}
            part["over"] = inherited | part["over"]
    if isinstance(own.get("run"), dict):
        own["run"] = {name: shared[name] for name in ("campaign", "variant") if name in shared} | own["run"]
    return own


def _check(place: str, entry: Entry) -> None:
    """Refuse an entry that shows nothing, or a part of it that does not say enough."""
    if not (entry.values or entry.curves or entry.points or entry.run or entry.missing):
        raise ReproduceError(
            f"{place} shows nothing; give it values, curves, points or a run, or say why it is missing"
        )
    if "" in entry.campaigns:
        raise ReproduceError(f"{place} does not name its campaign")
    parts: list[Value | Curve | Points] = [*entry.values, *entry.curves, *entry.points]
    for part in parts:
        if not part.metric:
            raise ReproduceError(f"{place}: '{part.label}' does not name its metric")
    for value in entry.values:
        if value.statistic == CALIBRATION_ERROR and value.over is not None:
            raise ReproduceError(
                f"{place}: '{value.label}' has no single trial's value to divide; leave out its 'over'"
            )
    for points in entry.points:
        if (points.setting is None) == (points.each is None):
            raise ReproduceError(
                f"{place}: '{points.label}' needs either a setting, or each of some estimators"
            )
        if points.each is not None and len(points.x or ()) != len(points.each):
            raise ReproduceError(
                f"{place}: '{points.label}' needs an x for each of its {len(points.each)} estimators"
            )
