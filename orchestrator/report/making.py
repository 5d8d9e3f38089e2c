"""Which page is made of what was given: of a run, of a campaign, or of several of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator.report.contents import Page

if TYPE_CHECKING:
    from orchestrator.report.groups import By


def page_for(paths: Sequence[Path], by: By | None = None) -> Page:
    """Return the page for a run, a campaign or, given several, for their comparison.

    ``by`` says by what estimators are told apart: see `orchestrator.report.groups.find_groups`; given it, a
    run is reported like a campaign of one trial. Raises `InputError` for anything else.
    """
    from orchestrator.evidence.sources import load_source

    sources = [load_source(path) for path in paths]
    if len(sources) == 1 and sources[0].kind == "run" and by is None:
        from orchestrator.report.run_report import run_page

        return run_page(sources[0].path)
    from orchestrator.report.campaign_report import campaign_page

    return campaign_page(sources, by)
