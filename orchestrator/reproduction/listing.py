"""The campaigns of a folder, as its ``reproduce.toml`` lists them: what a paper's figures are made from."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orchestrator.campaign.sweep import Campaign, Request, prepare
from orchestrator.errors import InputError
from orchestrator.topology.problems import did_you_mean

LIST = "reproduce.toml"
_KEYS: Mapping[str, type] = {"file": str, "trials": int, "set": list, "seed": int, "about": str}
_NEEDED = ("file", "trials")


class ReproduceError(InputError):
    """The list of campaigns cannot be used; the text names the place and the cure."""


@dataclass(frozen=True)
class Listed:
    """A campaign of the list, read and checked, with what it is for."""

    name: str
    about: str
    campaign: Campaign


def listed_campaigns(
    folder: Path,
    out: Path | None = None,
    *,
    only: Sequence[str] = (),
    trials: int | None = None,
    workers: int = 1,
    dask: str | None = None,
) -> list[Listed]:
    """Return the campaigns of a folder, all of them in order.

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
    entries = _read(folder)
    unknown = [name for name in only if name not in entries]
    if unknown:
        cure = did_you_mean(unknown[0], entries)
        raise ReproduceError(f"{folder / LIST} lists no campaign '{unknown[0]}'; {cure}")
    where = out or Path("runs") / "reproduce" / folder.resolve().name
    found = []
    for name, entry in entries.items():
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
    return found


def _read(folder: Path) -> dict[str, dict[str, Any]]:
    path = folder / LIST
    try:
        entries: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        cure = "give a folder of topologies that has one, such as topologies/ding2021"
        raise ReproduceError(f"{path} cannot be read: {error.strerror}; {cure}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ReproduceError(f"{path} is not TOML: {error}") from error
    for name, entry in entries.items():
        _check(path, name, entry)
    return entries


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
