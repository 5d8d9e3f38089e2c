"""The directory of a campaign: what it is, what of it is done, and nothing half written.

While it runs, finished trials stand in shards, each written whole or not at all; whatever is killed when, the
same command goes on with the trials that no shard holds.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from orchestrator.errors import InputError
from orchestrator.evidence.sources import CAMPAIGN, TOPOLOGIES

SHARDS = "shards"
TIMING = "timing.parquet"
WORKER_LOGS = "workers"
_LOCK = ".lock"
_SHARD = re.compile(r"(\d+)-(\d+)-(\d+)\.arrows")
_MOST_CAMPAIGNS = 100_000
_SHOWN = 100


class CampaignError(InputError):
    """The directory cannot hold this campaign; the text tells the cure."""


class Shard(NamedTuple):
    """A shard by what its name says: a variant's trials from first to last."""

    variant: int
    first: int
    last: int
    path: Path


def first_free(name: str, seed: int) -> Path:
    """Return the directory of a new campaign that was given none: the first free ``runs/<name>-...``."""
    for number in range(1, _MOST_CAMPAIGNS):
        path = Path("runs") / f"{name}-seed{seed}-sweep-{number}"
        if not path.exists():
            return path
    raise CampaignError(f"runs holds {_MOST_CAMPAIGNS} campaigns of {name}; remove some or give --out")


def write_whole(path: Path, content: bytes) -> None:
    """Write a file in one stroke: it is there with all of its content, or as it was before."""
    beside = path.with_name(f".{path.name}.part")
    with beside.open("wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    beside.replace(path)


class CampaignDirectory:
    """A directory that holds one campaign, locked while it is open.

    Parameters
    ----------
    path
        Where; it is made when it is not there.
    facts
        What the campaign is; all but ``trials`` must be the same when it goes on.
    topologies
        The resolved topology of each variant, as text.

    Raises
    ------
    CampaignError
        The directory holds another campaign or something else, or is in use.
    """

    def __init__(self, path: Path, facts: Mapping[str, Any], topologies: Sequence[str]) -> None:
        self.path = path
        held = read_facts(path)
        if held is not None:
            _check_same(path, held, facts)
        elif path.exists() and (not path.is_dir() or any(_foreign(path))):
            raise CampaignError(f"{path} holds something else; choose an empty directory as --out")
        self.is_resumed = held is not None
        (path / TOPOLOGIES).mkdir(parents=True, exist_ok=True)
        (path / SHARDS).mkdir(exist_ok=True)
        (path / WORKER_LOGS).mkdir(exist_ok=True)
        for number, text in enumerate(topologies):
            write_whole(self.topology(number), text.encode())
        write_whole(path / CAMPAIGN, json.dumps(facts, indent=2, ensure_ascii=False).encode() + b"\n")

    def topology(self, variant: int) -> Path:
        """Return the file of a variant's resolved topology."""
        return topology_file(self.path, variant)

    def shards(self) -> list[Shard]:
        """Return the shards that are there, sorted by variant and trial."""
        found = []
        for file in (self.path / SHARDS).iterdir():
            match = _SHARD.fullmatch(file.name)
            if match is not None:
                variant, first, last = map(int, match.groups())
                found.append(Shard(variant, first, last, file))
        return sorted(found)

    def write_shard(self, variant: int, trials: Sequence[int], content: bytes) -> None:
        """Keep the answer of a block."""
        name = f"{variant:05d}-{trials[0]:07d}-{trials[-1]:07d}.arrows"
        write_whole(self.path / SHARDS / name, content)

    def remove_shards(self) -> None:
        """Remove what a whole results file makes superfluous."""
        for file in (self.path / SHARDS).iterdir():
            file.unlink()
        (self.path / SHARDS).rmdir()


def topology_file(directory: Path, variant: int) -> Path:
    """Return where the resolved topology of a variant stands."""
    return directory / TOPOLOGIES / f"variant-{variant:03d}.yaml"


def read_facts(directory: Path) -> dict[str, Any] | None:
    """Return what ``campaign.json`` says, None when there is none."""
    try:
        facts: dict[str, Any] = json.loads((directory / CAMPAIGN).read_bytes())
    except (FileNotFoundError, NotADirectoryError):
        return None
    except ValueError as error:
        raise CampaignError(f"{directory / CAMPAIGN} is damaged: {error}; choose another --out") from error
    return facts


@contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Keep the directory for this process; the lock goes with the process, however it ends."""
    directory.mkdir(parents=True, exist_ok=True)
    with (directory / _LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise CampaignError(f"another sweep is at work in {directory}; wait for it") from error
        try:
            yield
        finally:
            (directory / _LOCK).unlink(missing_ok=True)


def _foreign(path: Path) -> Iterator[Path]:
    """Return what no campaign that was killed at its very beginning can have left."""
    ours = {_LOCK, TOPOLOGIES, SHARDS, WORKER_LOGS, f".{CAMPAIGN}.part"}
    return (file for file in path.iterdir() if file.name not in ours)


def _check_same(path: Path, held: Mapping[str, Any], asked: Mapping[str, Any]) -> None:
    """Refuse to go on with a campaign that is another one than that of the directory."""
    differing = list(_differences(held, asked))
    if differing:
        lines = [f"{path} holds another campaign, whose results cannot be mixed with these:", *differing]
        cure = "  give the same command with the same versions to go on, or choose another --out"
        raise CampaignError("\n".join([*lines, cure]))
    if asked["trials"] < held["trials"]:
        raise CampaignError(
            f"{path} holds a campaign of {held['trials']} trials; ask for as many or more to go on with it"
        )


def _differences(held: Mapping[str, Any], asked: Mapping[str, Any]) -> Iterator[str]:
    """Return a line for each fact but ``trials`` that is not the same; versions are told one by one."""
    pairs = {name: (held.get(name), asked.get(name)) for name in (*held, *asked) if name != "trials"}
    before, now = (facts.get("versions", {}) for facts in (held, asked))
    pairs.pop("versions", None)
    pairs |= {name: (before.get(name), now.get(name)) for name in (*before, *now)}
    hashes = pairs.pop("topology_hashes", (None, None))
    differing = {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}
    for name, (there, here) in differing.items():
        yield f"  {name}: {_shown(there)} there, {_shown(here)} here"
    if hashes[0] != hashes[1] and not differing.keys() & {"overrides", "seed", "first_trial"}:
        yield "  the topology: its file, a file that it extends, or a class in it was changed"


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."
