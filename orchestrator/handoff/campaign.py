"""A campaign, loaded: frames and labelled arrays of all its trials."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from shlex import quote
from typing import TYPE_CHECKING, Any, NoReturn

from orchestrator.evidence.columns import state_groups
from orchestrator.evidence.sources import Source, SourceError
from orchestrator.evidence.table import swept
from orchestrator.handoff.columns import RECORDED
from orchestrator.handoff.evidence import EVIDENCE, EvidenceFrames
from orchestrator.handoff.frames import Library, require

if TYPE_CHECKING:
    import pyarrow as pa
    import xarray as xr


class Campaign(EvidenceFrames):
    """All trials of a campaign. What was recorded message by message is not kept: replay a trial for that.

    Frames (polars or pandas): `results`, a row a trial and estimator; `errors`, a row also for each step;
    `detections`, one for each packet judged; `windows`, one for each attack on a link. `arrays` is an
    `xarray.Dataset` by variant, trial, node and step.
    """

    kind = "campaign"

    def __init__(self, source: Source, library: Library) -> None:
        self.path = source.path
        self.name = source.name
        super().__init__(library)
        self._source = source

    def __repr__(self) -> str:
        """Tell what was run."""
        return f"<campaign {self.name} from {self.path}>"

    @property
    def provenance(self) -> Mapping[str, Any]:
        """What was run, with which versions."""
        return self._source.provenance

    @property
    def topologies(self) -> tuple[Mapping[str, Any], ...]:
        """The resolved topology of each variant, as plain data."""
        return self._source.documents

    @functools.cached_property
    def results(self) -> Any:
        """A row a trial and estimator: what was set, every metric, and whether the trial failed."""
        return self._frame("results")

    @functools.cached_property
    def arrays(self) -> xr.Dataset:
        """Arrays by ``variant``, ``trial``, ``node`` and ``step``, with their names as coordinates."""
        require("xarray")
        from orchestrator.handoff.arrays import campaign_arrays

        rows = self._source.table
        return campaign_arrays(rows, state_groups(rows), {"name": self.name})

    def table(self, name: str) -> pa.Table:
        """Return one of the frames as an Arrow table."""
        rows = self._source.table
        keys = ("variant", "trial", "seed", *swept(rows.column_names), "node", "method")
        return EVIDENCE[name](rows, keys, None)

    def __getattr__(self, name: str) -> NoReturn:
        """Tell where to find what only a run has."""
        if name in RECORDED:
            command = f"gauntlet replay {quote(str(self.path))} --trial 0"
            cure = f"write the log of a trial with `{command}`, and load that"
            raise SourceError(f"{self.path} is a campaign, and keeps no {name}; {cure}")
        raise AttributeError(f"a campaign has no {name}; it has {', '.join(EVIDENCE)} and arrays")
