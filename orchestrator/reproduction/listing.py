"""The campaigns of a folder and what is made of them, as its ``reproduce.toml`` lists both."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orchestrator.campaign.sweep import Campaign, Request, prepare
from orchestrator.evidence.calibration import STATED
from orchestrator.reproduction.claims import (
    CALIBRATION_ERROR,
    Curve,
    Entry,
    Place,
    Points,
    Value,
    read_entries,
)
from orchestrator.reproduction.errors import ReproduceError
from orchestrator.topology.names import select
from orchestrator.topology.problems import did_you_mean

LIST = "reproduce.toml"
FIGURES = "figure"
TITLE = "paper"
_KEYS: Mapping[str, type] = {"file": str, "trials": int, "set": list, "seed": int, "about": str}
_NEEDED = ("file", "trials")


@dataclass(frozen=True)
class Listed:
    """A campaign of the list, read and checked, with what it is for."""

    name: str
    about: str
    campaign: Campaign


@dataclass(frozen=True)
class Listing:
    """What a folder lists: its campaigns, and the paper's figures and tables that are made of them.

    ``left_out`` are campaigns that are listed and were not asked for.
    """

    title: str
    where: Path
    campaigns: list[Listed]
    entries: list[Entry]
    left_out: frozenset[str]


def read_listing(
    folder: Path,
    out: Path | None = None,
    *,
    only: Sequence[str] = (),
    trials: int | None = None,
    workers: int = 1,
    dask: str | None = None,
) -> Listing:
    """Return what a folder lists, all of it in order.

    Parameters
    ----------
    folder
        Where ``reproduce.toml`` stands, beside the topologies that it names.
    out
        Where each campaign gets a directory of its own name. Default: ``runs/reproduce/`` and the folder's.
    only
        The names of those that are wanted; all when there are none.
    trials
        The most trials of each variant, for a first look; more can be asked for later.
    workers, dask
        Who carries them out, as in `Request`.

    Raises
    ------
    InputError
        The list or one of the campaigns is not in order.
    """
    title, listed, figures = _read(folder)
    unknown = [name for name in only if name not in listed]
    if unknown:
        cure = did_you_mean(unknown[0], listed)
        raise ReproduceError(f"{folder / LIST} lists no campaign '{unknown[0]}'; {cure}")
    where = out or Path("runs") / "reproduce" / folder.resolve().name
    found = []
    for name, entry in listed.items():
        if only and name not in only:
            continue
        count = entry["trials"] if trials is None else min(trials, entry["trials"])
        request = Request(
            folder / entry["file"],
            count,
            overrides=tuple(entry.get("set", ())),
            seed=entry.get("seed"),
            out=where / name,
            workers=workers,
            dask=dask,
        )
        found.append(Listed(name, entry.get("about", ""), prepare(request)))
    entries = read_entries(str(folder / LIST), figures)
    for one in entries:
        _check_entry(folder / LIST, one, found, listed)
    left_out = frozenset(listed) - {own.name for own in found}
    return Listing(title or folder.resolve().name, where, found, entries, left_out)


def _read(folder: Path) -> tuple[str, dict[str, dict[str, Any]], list[Any]]:
    """Return the paper's title, the campaigns by name, checked, and the figures as they are written."""
    path = folder / LIST
    try:
        entries: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        cure = "give a folder of topologies that has one, such as topologies/ding2021"
        raise ReproduceError(f"{path} cannot be read: {error.strerror}; {cure}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ReproduceError(f"{path} is not TOML: {error}") from error
    figures, title = entries.pop(FIGURES, []), entries.pop(TITLE, "")
    if not isinstance(figures, list):
        raise ReproduceError(
            f"{path}: no campaign can be called '{FIGURES}'; write [[{FIGURES}]] for a figure"
        )
    for name, entry in entries.items():
        _check(path, name, entry)
    return str(title), entries, figures


def _check(path: Path, name: str, entry: Any) -> None:
    """Refuse an entry that has not what a campaign needs, or something that it does not know."""
    if not isinstance(entry, dict):
        raise ReproduceError(f"{path}: {name} is no campaign; write [{name}] and its keys below")
    missing = [key for key in _NEEDED if key not in entry]
    if missing:
        raise ReproduceError(f"{path}: [{name}] does not say its {' and '.join(missing)}")
    for key, value in entry.items():
        if key not in _KEYS:
            raise ReproduceError(f"{path}: [{name}] has no key '{key}'; {did_you_mean(key, _KEYS)}")
        if not isinstance(value, _KEYS[key]):
            raise ReproduceError(f"{path}: [{name}] {key} is no {_KEYS[key].__name__}: {value!r}")
    if entry["trials"] < 1:
        raise ReproduceError(f"{path}: [{name}] needs at least one trial")


def _check_entry(path: Path, entry: Entry, found: Sequence[Listed], listed: Mapping[str, Any]) -> None:
    """Refuse a figure that needs what is not there: a campaign, a variant, an estimator, a metric."""
    campaigns = {own.name: own.campaign for own in found}
    place = f"{path}: [[{FIGURES}]] '{entry.name}'"
    for name in entry.campaigns:
        if name not in listed:
            raise ReproduceError(f"{place}: there is no campaign '{name}'; {did_you_mean(name, listed)}")
    parts: list[Place] = [*entry.values, *entry.curves, *entry.points]
    parts += [value.over for value in entry.values if value.over is not None]
    for part in parts:
        if part.campaign in campaigns:
            _check_part(place, part, campaigns[part.campaign])


def _suitable(part: Place, campaign: Campaign) -> tuple[str, list[str]]:
    """Return what a part needs of a campaign's results, in words, and the columns that are such."""
    if isinstance(part, Value | Points) and part.statistic == CALIBRATION_ERROR:
        return "series of probabilities", [STATED]
    is_series = isinstance(part, Curve)
    own = [one.name for one in campaign.schema() if str(one.type).startswith("list<") == is_series]
    return "series" if is_series else "metric", own


def _check_part(place: str, part: Place, campaign: Campaign) -> None:
    if part.variant >= len(campaign.variants):
        last = len(campaign.variants) - 1
        raise ReproduceError(f"{place}: '{part.campaign}' has no variant {part.variant}, the last is {last}")
    topology = campaign.variants[part.variant].topology
    names = [own.name for own in topology.plan.estimators]
    each = part.each if isinstance(part, Points) and part.each is not None else part.nodes
    for pattern in each:
        if not select(pattern, names):
            cure = did_you_mean(pattern, names)
            raise ReproduceError(f"{place}: '{part.campaign}' has no estimator '{pattern}'; {cure}")
    what, columns = _suitable(part, campaign)
    if part.metric not in columns:
        cure = did_you_mean(part.metric, columns)
        raise ReproduceError(f"{place}: '{part.campaign}' has no {what} '{part.metric}'; {cure}")
    if isinstance(part, Points) and part.setting is not None and part.setting not in campaign.swept:
        cure = did_you_mean(part.setting, campaign.swept)
        raise ReproduceError(f"{place}: '{part.campaign}' does not vary '{part.setting}'; {cure}")
