"""A run, loaded: frames and labelled arrays of what happened in it."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from orchestrator.evidence.rows import gathered_rows
from orchestrator.evidence.table import schema, table
from orchestrator.handoff.columns import RECORDED, Rows, column_types, component_names
from orchestrator.handoff.evidence import EVIDENCE, EvidenceFrames
from orchestrator.handoff.frames import Library, arrow_table, require
from orchestrator.log.reader import read_log
from orchestrator.score.gather import Gathered, Gatherer
from orchestrator.score.results import Score
from orchestrator.score.scoring import Evidence
from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology_score import score_topology

if TYPE_CHECKING:
    import pyarrow as pa
    import xarray as xr

TABLES = (*RECORDED, *EVIDENCE)
"""Every table of a run: as it was recorded, and as it is scored."""

_KEYS = ("node", "method")


class _Record(NamedTuple):
    """One pass over the messages: the rows of the tables, and the arrays of the score."""

    rows: Rows
    gathered: Gathered


class Run(EvidenceFrames):
    """One run: what its log holds, in the terms of state estimation.

    Frames (polars or pandas), each computed when it is first asked for: `truth`, `estimates`, `diagnostics`,
    `packets`, `links`, `events` as they were recorded; `errors`, `detections`, `windows`, `results` as they
    are scored. `arrays` is an `xarray.Dataset` by node, step and component.
    """

    kind = "run"

    def __init__(self, path: Path, library: Library = "polars") -> None:
        self.path = path
        super().__init__(library)
        self._log = read_log(path)
        self._topology = topology_from_experiment(self._log.topology_json)
        self.name = self._topology.name
        self.seed = self._topology.plan.seed

    def __repr__(self) -> str:
        """Tell what was run."""
        return f"<run {self.name}, seed {self.seed}, from {self.path}>"

    @property
    def provenance(self) -> Mapping[str, str]:
        """What was run, with which versions."""
        return self._log.provenance

    @property
    def topology(self) -> Mapping[str, Any]:
        """The resolved topology as plain data."""
        return self._topology.document

    @functools.cached_property
    def components(self) -> list[str]:
        """The names of the state's components."""
        size = self._record.gathered.estimates.error.shape[2]
        return component_names(self._topology.state_groups, size)

    @functools.cached_property
    def truth(self) -> Any:
        """The plant: ``step``, ``t``, a column a state component, ``control`` and ``attack``."""
        return self._frame("truth")

    @functools.cached_property
    def estimates(self) -> Any:
        """A row an estimate: ``step``, ``node``, ``refers_to``, ``nis``, the state and its ``sigma_*``.

        ``covariance`` is a list of n * n numbers, row by row.
        """
        return self._frame("estimates")

    @functools.cached_property
    def diagnostics(self) -> Any:
        """A row a figure that an estimator told of itself: ``step``, ``node``, ``name``, ``value``."""
        return self._frame("diagnostics")

    @functools.cached_property
    def packets(self) -> Any:
        """A row a packet, sent (``direction`` tx) or received (rx), with its ``values``."""
        return self._frame("packets")

    @functools.cached_property
    def links(self) -> Any:
        """A row a link, step and round: how many packets were sent, lost, attacked, delivered, ..."""
        return self._frame("links")

    @functools.cached_property
    def events(self) -> Any:
        """A row an act of the channel: which stage did what to which packet of which link."""
        return self._frame("events")

    @functools.cached_property
    def results(self) -> Any:
        """A row an estimator: every metric that ``expect:`` knows."""
        return self._frame("results")

    @functools.cached_property
    def arrays(self) -> xr.Dataset:
        """Arrays by ``node``, ``step``, ``component`` and ``group``, with their names as coordinates."""
        require("xarray")
        from orchestrator.handoff.arrays import run_arrays

        tables = self.table("estimates"), self.table("truth")
        return run_arrays(self._topology, self._evidence, self.components, *tables, self._rows)

    @functools.cached_property
    def score(self) -> Score:
        """The score, computed from the record."""
        return self._scored[0]

    def table(self, name: str) -> pa.Table:
        """Return one of the frames as an Arrow table."""
        if name in RECORDED:
            return arrow_table(column_types(self.components)[name], self._record.rows.rows[name])
        return EVIDENCE[name](self._rows, _KEYS, self._topology.plan.period_s)

    @functools.cached_property
    def _record(self) -> _Record:
        plan = self._topology.plan
        methods = {own.name: own.kind.reference.rpartition(":")[2] for own in plan.estimators}
        rows, gatherer = Rows(methods), Gatherer(plan)
        for topic, message in self._log.records():
            rows.take(topic, message)
            gatherer.take(topic, message)
        return _Record(rows, gatherer.finish())

    @functools.cached_property
    def _scored(self) -> tuple[Score, Evidence]:
        return score_topology(self._topology, self._record.gathered, self._log.departed)

    @property
    def _evidence(self) -> Evidence:
        return self._scored[1]

    @functools.cached_property
    def _rows(self) -> pa.Table:
        """The rows of evidence, one an estimator."""
        rows = gathered_rows(self._topology, self._record.gathered, self._log.departed)
        return table(rows, schema(self._topology.state_groups))
