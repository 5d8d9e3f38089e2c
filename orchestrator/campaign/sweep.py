"""A campaign from its topology to its results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from orchestrator.backends.fleet import kind_modules
from orchestrator.campaign.agenda import Agenda
from orchestrator.campaign.block import Work
from orchestrator.campaign.directory import (
    WORKER_LOGS,
    CampaignDirectory,
    first_free,
    locked,
)
from orchestrator.campaign.grid import Variant, lay_grid
from orchestrator.campaign.results import finished_trials, write_results
from orchestrator.campaign.user_code import code_of
from orchestrator.campaign.variants import LoadedVariant, load_variants, refuse_alike
from orchestrator.campaign.workers import LocalWorkers
from orchestrator.errors import InputError
from orchestrator.evidence.rows import FAILED
from orchestrator.evidence.table import require_pyarrow, schema
from orchestrator.log.provenance import versions
from orchestrator.topology.problems import Problem
from orchestrator.topology.schema import LARGEST_TRIAL

if TYPE_CHECKING:
    import pyarrow as pa

TRIAL_TIMEOUT_S = 3600.0
_FORMAT = 2


@dataclass(frozen=True)
class Request:
    """What is asked for: the command line of ``gauntlet sweep``."""

    file: Path
    trials: int
    first_trial: int = 0
    overrides: Sequence[str] = ()
    seed: int | None = None
    out: Path | None = None
    workers: int = 1
    dask: str | None = None
    twins: bool = False
    trial_timeout_s: float = TRIAL_TIMEOUT_S


class Workers(Protocol):
    """Who carries out the blocks of an agenda, here or elsewhere."""

    count: int

    def answers(self, agenda: Agenda) -> Iterator[tuple[Work, bytes]]:
        """Yield each block with the Arrow stream of its rows, as they come."""
        ...


@dataclass(frozen=True)
class Campaign:
    """A campaign that is read and checked; nothing of it is written yet."""

    request: Request
    variants: Sequence[LoadedVariant]

    @property
    def name(self) -> str:
        """The name of its topology."""
        return self.variants[0].topology.name

    @property
    def seed(self) -> int:
        """The seed of the topology; a variant may have another."""
        return self.variants[0].topology.plan.seed

    @property
    def trials(self) -> range:
        """The numbers of all trials."""
        return range(self.request.first_trial, self.request.first_trial + self.request.trials)

    @property
    def swept(self) -> list[str]:
        """The paths that have several values."""
        return list(self.variants[0].variant.settings)

    @property
    def warnings(self) -> list[Problem]:
        """What is likely a mistake, each once."""
        found = (warning for own in self.variants for warning in own.topology.warnings)
        return list(dict.fromkeys(found))

    @cached_property
    def code(self) -> dict[str, str]:
        """What is known of the code of a user's own that any variant runs; see `code_of`."""
        return code_of(own.topology.plan for own in self.variants)

    def schema(self) -> pa.Schema:
        """Return the columns of the results: those of every variant."""
        groups = {group for own in self.variants for group in own.topology.state_groups}
        return schema(sorted(groups), self.swept)

    def facts(self) -> dict[str, Any]:
        """Return what ``campaign.json`` says; a campaign goes on only with the same, ``trials`` aside."""
        settings = [own.variant.settings for own in self.variants]
        swept = {path: list(dict.fromkeys(own[path] for own in settings)) for path in self.swept}
        return {
            "format": _FORMAT,
            "name": self.name,
            "file": self.request.file.name,
            "seed": self.seed,
            "first_trial": self.request.first_trial,
            "trials": self.request.trials,
            "overrides": list(self.request.overrides),
            "swept": swept,
            "variants": [dict(own) for own in settings],
            "code": self.code,
            "topology_hashes": [own.topology.hash for own in self.variants],
            "versions": versions(),
        }


class Progress(Protocol):
    """Told how far a campaign has come."""

    def begin(self, total: int, done: int) -> None:
        """Take the number of all trials, and of those that were done before."""
        ...

    def advance(self, finished: int, failed: int) -> None:
        """Take the number of trials that a block finished, and how many of them failed."""
        ...


def prepare(request: Request) -> Campaign:
    """Return a campaign whose variants are all in order; raises `InputError` with everything that is not."""
    require_pyarrow()
    last = request.first_trial + request.trials - 1
    if last > LARGEST_TRIAL:
        cure = "give a smaller --first-trial or fewer --trials"
        raise InputError(f"the last trial would be {last}, and the largest is {LARGEST_TRIAL}; {cure}")
    variants: Sequence[Variant] = lay_grid(request.overrides, request.twins)
    loaded = load_variants(request.file, variants, request.seed, request.first_trial)
    if request.twins and all(one.topology.hash == two.topology.hash for one, two in pairwise(loaded)):
        raise InputError(f"--twin: {request.file} has no attacks, so that its twin would be the same")
    refuse_alike(loaded)
    return Campaign(request, loaded)


def sweep(campaign: Campaign, progress: Progress) -> Path:
    """Run what is left of a campaign and write its results; return its directory.

    Raises
    ------
    InputError
        The directory holds another campaign, or the workers cannot be had.
    """
    path = campaign.request.out or first_free(campaign.name, campaign.seed)
    with locked(path):
        texts = [own.topology.resolved_yaml() for own in campaign.variants]
        directory = CampaignDirectory(path, campaign.facts(), texts)
        done = finished_trials(path, directory.shards())
        wanted = {(own.variant.number, trial) for own in campaign.variants for trial in campaign.trials}
        progress.begin(len(wanted), len(wanted & done))
        if wanted - done:
            with _workers(campaign, path / WORKER_LOGS) as workers:
                agenda = Agenda(campaign.variants, campaign.trials, done, workers.count)
                for work, answer in workers.answers(agenda):
                    directory.write_shard(work.variant, work.trials, answer)
                    progress.advance(len(work.trials), _failed(answer))
        shards = directory.shards()
        if shards:
            write_results(path, shards, campaign.schema(), campaign.trials)
        directory.remove_shards(campaign.trials)
    return path


def _workers(campaign: Campaign, log_dir: Path) -> AbstractContextManager[Workers]:
    request = campaign.request
    if request.dask is not None:
        from orchestrator.campaign.dask_workers import DaskWorkers

        return DaskWorkers(request.dask, log_dir, request.trial_timeout_s, campaign.code)
    modules = {name for own in campaign.variants for name in kind_modules(own.topology.plan)}
    names = [str(number) for number in range(1, request.workers + 1)]
    return LocalWorkers(names, modules, log_dir, request.trial_timeout_s)


def _failed(answer: bytes) -> int:
    """Return how many trials of a block failed; each of them is one row."""
    import pyarrow as pa

    with pa.ipc.open_stream(answer) as reader:
        return int(reader.read_all()["status"].to_pylist().count(FAILED))
