"""Which page is made of what was given: of a run, of a campaign, or of several of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from orchestrator.report.contents import Page
from orchestrator.report.errors import ReportError
from orchestrator.run_directory import LOG


def page_for(paths: Sequence[Path], by: str | None = None) -> Page:
    """Return the page for a run, a campaign or, given several, for their comparison.

    ``by`` names the setting whose variants are compared. Raises `InputError` for anything else.
    """
    (path,) = paths
    log = path / LOG if path.is_dir() else path
    if not log.is_file():
        cure = "give the directory of a run or a campaign, or a log (.mcap)"
        raise ReportError(f"{path} holds no run and no campaign; {cure}")
    from orchestrator.report.run_report import run_page

    return run_page(log)
