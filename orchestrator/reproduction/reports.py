"""The reports of a finished listing: one a campaign, one a single trial, and the paper's page over them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from orchestrator.report.contents import Page
from orchestrator.report.making import page_for
from orchestrator.report.page import write_page
from orchestrator.reproduction.blocks import run_page_name
from orchestrator.reproduction.listing import Listing
from orchestrator.reproduction.one_trial import run_again
from orchestrator.reproduction.page import INDEX, REPORT, paper_page


def write_reports(listing: Listing) -> Iterator[Path]:
    """Write the report of each campaign and of each trial that a figure shows; yield the files."""
    for own in listing.campaigns:
        campaign = listing.where / own.name
        out = campaign / REPORT
        write_page(page_for([campaign]), out)
        yield out
    done = set()
    for entry in listing.entries:
        if entry.run is None or entry.run in done or entry.run.campaign in listing.left_out:
            continue
        done.add(entry.run)
        campaign = listing.where / entry.run.campaign
        out = campaign / run_page_name(entry)
        write_page(page_for([run_again(campaign, entry.run)]), out)
        yield out


def write_index(listing: Listing) -> tuple[Path, Page]:
    """Write the paper's page and return its file, and the page."""
    page = paper_page(listing)
    out = listing.where / INDEX
    write_page(page, out)
    return out, page
