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
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from orchestrator.backends.contract import RunFailedError
from orchestrator.campaign.differences import differences
from orchestrator.errors import InputError
from orchestrator.evidence.campaign_facts import CAMPAIGN, campaign_facts
from orchestrator.evidence.sources import TOPOLOGIES, topology_file, trials_there

SHARDS = "shards"
TIMING = "timing.parquet"
WORKER_LOGS = "workers"
_LOCK = ".lock"
_SHARD = re.compile(r"(\d+)-(\d+)-(\d+)\.arrows")
_MOST_CAMPAIGNS = 100_000


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


@contextmanager
def in_one_stroke(path: Path) -> Iterator[Path]:
    """Let a file be written beside its place; when that is done it takes the place of what was there.

    Raises `RunFailedError` when it cannot be written.
    """
    beside = path.with_name(f".{path.name}.part")
    try:
        yield beside
        with beside.open("rb") as stream:
            os.fsync(stream.fileno())
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise RunFailedError(
            f"{path} cannot be written: {error.strerror or error}; free some space and give the command "
            "again, which goes on where it ended"
        ) from error


def write_whole(path: Path, content: bytes) -> None:
    """Write a file: it is there with all of its content, or as it was before."""
    with in_one_stroke(path) as beside:
        beside.write_bytes(content)


class CampaignDirectory:
    """A directory that holds one campaign.

    Parameters
    ----------
    path
        Where it is, locked by this process.
    facts
        What the campaign is; all but ``trials`` must be the same when it goes on.
    topologies
        The resolved topology of each variant, as text.

    Raises
    ------
    CampaignError
        The directory holds another campaign or something else.
    """

    def __init__(self, path: Path, facts: Mapping[str, Any], topologies: Sequence[str]) -> None:
        self.path = path
        held = read_facts(path)
        if held is not None:
            _check_same(path, held, facts)
        elif any(_foreign(path)):
            raise CampaignError(f"{path} holds something else; choose an empty directory as --out")
        self.is_resumed = held is not None
        (path / TOPOLOGIES).mkdir(exist_ok=True)
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

    def remove_shards(self, trials: range) -> None:
        """Remove what a results file of these trials makes superfluous; later ones stay for a longer one."""
        kept = {shard.path for shard in self.shards() if shard.last not in trials}
        for file in (self.path / SHARDS).iterdir():
            if file not in kept:
                file.unlink()
        if not kept:
            (self.path / SHARDS).rmdir()


def read_facts(directory: Path) -> dict[str, Any] | None:
    """Return what ``campaign.json`` says, None when there is none."""
    try:
        return campaign_facts((directory / CAMPAIGN).read_bytes())
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as error:
        raise CampaignError(
            f"{directory} is a damaged campaign ({error}); give its 'gauntlet sweep' again with another --out"
        ) from error


@contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Make the directory and keep it for this process; the lock goes with the process, however it ends."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        held = (directory / _LOCK).open("w")
    except OSError as error:
        raise CampaignError(f"{directory} cannot be used: {error.strerror}; choose another --out") from error
    with held as lock:
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
    found = differences(held, asked)
    if found:
        cures = " and ".join(dict.fromkeys(own.cure for own in found))
        raise CampaignError(
            "\n".join(
                [
                    f"{path} holds another campaign, whose results cannot be mixed with these:",
                    *(own.line for own in found),
                    f"  to go on with it, {cures}; to begin another one, choose another --out",
                ]
            )
        )
    import pyarrow as pa

    there = 0
    with suppress(pa.ArrowException, OSError):  # those that are damaged are told when their rows are read
        there = trials_there(path, held["first_trial"])
    if asked["trials"] < there:
        raise CampaignError(
            f"{path} holds the results of {there} trials; ask for as many or more to go on with it"
        )
