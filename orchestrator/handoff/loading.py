"""From a path to a run or a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, get_args

if TYPE_CHECKING:
    from orchestrator.handoff.campaign import Campaign
    from orchestrator.handoff.frames import Library
    from orchestrator.handoff.run import Run


def load(path: str | Path, frames: Library = "polars") -> Run | Campaign:
    """Return a run or a campaign with its frames and labelled arrays.

    Parameters
    ----------
    path
        The folder of a run or a campaign, a log (``.mcap``), or a campaign's ``results.parquet``.
    frames
        ``polars`` or ``pandas``: what frames are made with.

    Returns
    -------
    Run or Campaign
        `orchestrator.handoff.run.Run`, or `orchestrator.handoff.campaign.Campaign`. Nothing but the file's
        beginning is read until a frame is asked for.

    Raises
    ------
    InputError
        When nothing of that kind is there, it is damaged, or a package is missing; the text tells the cure.
    """
    from orchestrator.errors import InputError
    from orchestrator.evidence.sources import load_source
    from orchestrator.handoff.campaign import Campaign
    from orchestrator.handoff.frames import Library, require
    from orchestrator.handoff.run import Run

    if frames not in get_args(Library):
        raise InputError(f"there are no frames of {frames!r}; take one of {', '.join(get_args(Library))}")
    require("pyarrow", frames)
    source = load_source(path)
    return Run(source.path, frames) if source.kind == "run" else Campaign(source, frames)
