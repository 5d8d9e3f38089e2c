"""Which page is made of what was given: of a run, of a campaign, or of several of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from orchestrator.report.contents import Page


def page_for(named: Sequence[Path | str], by: str | None = None) -> Page:
    """Return the page for a run, a campaign or, given several, for their comparison.

    Each is a path or some variants of one, as `orchestrator.evidence.chosen.choose` reads it. ``by`` says by
    what estimators are told apart: see `orchestrator.report.grouping.find_groups`; given it, a run is
    reported like a campaign of one trial. Raises `InputError` for anything else.
    """
    from orchestrator.evidence.chosen import choose

    chosen = list(map(choose, named))
    if len(chosen) == 1 and chosen[0].source.kind == "run" and by is None:
        from orchestrator.report.run_report import run_page

        return run_page(chosen[0].source.path)
    from orchestrator.report.campaign_report import campaign_page

    return campaign_page(chosen, by)
