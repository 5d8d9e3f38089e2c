"""Where evidence comes from: a run's log or a campaign's results, opened in one way."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from orchestrator.errors import InputError
from orchestrator.evidence.campaign_facts import CAMPAIGN, campaign_facts
from orchestrator.evidence.table import require_pyarrow, schema, table
from orchestrator.run_directory import LOG

if TYPE_CHECKING:
    import pyarrow as pa

RESULTS = "results.parquet"
TOPOLOGIES = "topologies"


class SourceError(InputError):
    """There is nothing to read; the text names the place and the cure."""


@dataclass(frozen=True)
class Source:
    """Rows and where they come from.

    Parameters
    ----------
    kind
        A single run, or a campaign.
    name
        The name of the topology that was run.
    path
        The log of a run, or the directory of a campaign.
    provenance
        What was run with which versions: the facts of the log, or those of ``campaign.json``. Where a
        campaign was to have more trials than its results hold, ``trials`` tells how many these are, and
        ``unfinished`` tells both in a sentence.
    """

    kind: Literal["run", "campaign"]
    name: str
    path: Path
    provenance: Mapping[str, Any]

    @property
    def unfinished(self) -> tuple[str, ...]:
        """A sentence on the trials that a campaign was to have and its results lack, if they lack any."""
        return (self.provenance["unfinished"],) if "unfinished" in self.provenance else ()

    @functools.cached_property
    def table(self) -> pa.Table:
        """The rows, as `orchestrator.evidence.table` describes their columns."""
        return _table_of_log(self.path) if self.kind == "run" else _table_of_campaign(self.path)

    @functools.cached_property
    def metrics(self) -> list[str]:
        """The columns that hold one number for each estimator of a trial."""
        import pyarrow as pa

        return [field.name for field in self._schema() if pa.types.is_floating(field.type)]

    @property
    def variants(self) -> Mapping[int, Mapping[str, str]]:
        """The variants by number, each with the value of every path that varies; a run is its only one."""
        return {0: {}} if self.kind == "run" else dict(enumerate(self.provenance["variants"]))

    def read(self, wanted: Callable[[str], bool], variants: Collection[int] | None = None) -> pa.Table:
        """Return the rows of some variants, or of all, with the wanted columns only.

        Those of a large campaign are many: what is not wanted is not read.
        """
        names = [name for name in self._schema().names if wanted(name)]
        if self.kind == "run":
            return self.table.select(names)
        import pyarrow.parquet as pq

        chosen = None if variants is None else [("variant", "in", sorted(variants))]
        return pq.read_table(self.path / RESULTS, columns=names, filters=chosen)

    def _schema(self) -> pa.Schema:
        if self.kind == "run":
            return self.table.schema
        import pyarrow.parquet as pq

        return pq.read_schema(self.path / RESULTS)

    def document(self, variant: int) -> Mapping[str, Any]:
        """Return the resolved topology of a variant as plain data; raises `SourceError` if it is missing."""
        if variant not in self._documents:
            self._documents[variant] = self._read_document(variant)
        return self._documents[variant]

    def _read_document(self, variant: int) -> Mapping[str, Any]:
        if self.kind == "run":
            from orchestrator.log.reader import read_log

            document: Mapping[str, Any] = read_log(self.path, check=False).topology["topology"]
            return document
        from ruamel.yaml import YAML

        file = topology_file(self.path, variant)
        if not file.is_file():
            raise SourceError(
                f"{file} is missing, a topology of the campaign; "
                "give its 'gauntlet sweep' again with another --out"
            )
        found: Mapping[str, Any] = YAML(typ="safe", pure=True).load(file)
        return found

    @functools.cached_property
    def _documents(self) -> dict[int, Mapping[str, Any]]:
        return {}

    @property
    def documents(self) -> tuple[Mapping[str, Any], ...]:
        """The resolved topology of each variant as plain data; that of a run is its only one."""
        return tuple(map(self.document, self.variants))


def topology_file(directory: Path, variant: int) -> Path:
    """Return where the resolved topology of a campaign's variant stands."""
    return directory / TOPOLOGIES / f"variant-{variant:03d}.yaml"


def load_source(path: Path | str) -> Source:
    """Open a run directory, a log (``.mcap``) or a campaign directory.

    Raises
    ------
    InputError
        There is none of these, it cannot be read, or a package for reading it is missing.
    """
    require_pyarrow()
    given = Path(path)
    if given.name == RESULTS:
        given = given.parent
    if given.is_dir() and (given / CAMPAIGN).is_file():
        return _campaign(given)
    log = given / LOG if given.is_dir() else given
    if not log.is_file():
        cure = "give the directory of a run or a campaign, or a log (.mcap)"
        raise SourceError(f"{given} holds no run and no campaign; {cure}")
    from orchestrator.log.reader import read_log

    opened = read_log(log, check=False)
    return Source("run", opened.provenance["name"], log, opened.provenance)


def trials_there(directory: Path, first_trial: int) -> int:
    """Return how many trials of each variant the results of a campaign hold, 0 when there are none.

    Raises `OSError` or `pyarrow.ArrowException` when they cannot be read.
    """
    import pyarrow.parquet as pq

    if not (directory / RESULTS).exists():
        return 0
    held = pq.read_metadata(directory / RESULTS)
    groups = (held.row_group(number) for number in range(held.num_row_groups))
    columns = (group.column(place) for group in groups for place in range(group.num_columns))
    last = [own.statistics.max for own in columns if own.path_in_schema == "trial" and own.statistics]
    return max(last) - first_trial + 1 if last else 0


def _campaign(directory: Path) -> Source:
    if not (directory / RESULTS).is_file():
        raise SourceError(
            f"{directory} is an unfinished campaign; "
            "give its 'gauntlet sweep' again, which goes on where it ended"
        )
    import pyarrow as pa

    try:
        facts = campaign_facts((directory / CAMPAIGN).read_bytes())
        there = trials_there(directory, facts["first_trial"])
    except (ValueError, OSError, pa.ArrowException) as error:
        reason = str(error).splitlines()[0]
        raise SourceError(
            f"{directory} is a damaged campaign ({reason}); "
            "give its 'gauntlet sweep' again with another --out"
        ) from error
    if 0 < there < facts["trials"]:
        facts["unfinished"] = (
            f"{directory}: {there} of {facts['trials']} trials are there; give its 'gauntlet sweep' again to "
            f"go on, or with --trials {there} to leave it at these"
        )
        facts["trials"] = there
    return Source("campaign", facts["name"], directory, facts)


def _table_of_log(log: Path) -> pa.Table:
    from orchestrator.evidence.rows import trial_rows
    from orchestrator.log.reader import read_log
    from orchestrator.topology.experiment import topology_from_experiment

    opened = read_log(log, check=False)
    topology = topology_from_experiment(opened.topology_json)
    rows = trial_rows(topology, opened.records(), opened.departed)
    return table(rows, schema(topology.state_groups))


def _table_of_campaign(directory: Path) -> pa.Table:
    import pyarrow.parquet as pq

    return pq.read_table(directory / RESULTS)
