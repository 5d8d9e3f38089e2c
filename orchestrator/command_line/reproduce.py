"""`gauntlet reproduce`: a paper's campaigns, figures and tables, by one command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from orchestrator import exit_codes
from orchestrator.command_line.options import DaskAddress, Jobs, Json
from orchestrator.command_line.output import print_json
from orchestrator.command_line.report import Form, picture_form
from orchestrator.command_line.sweep import carry_out, cpus
from orchestrator.errors import InputError

if TYPE_CHECKING:
    from orchestrator.report.contents import Page
    from orchestrator.reproduction.listing import Listing


def reproduce(
    folder: Annotated[
        Path,
        typer.Argument(metavar="FOLDER", help="A folder with a reproduce.toml.", show_default=False),
    ],
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only this campaign of the list. Repeatable.", show_default=False),
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(help="At most so many trials of each variant, for a first look.", min=1),
    ] = None,
    jobs: Jobs = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Where it all goes. Default: runs/reproduce/FOLDER.", show_default=False),
    ] = None,
    dask: DaskAddress = None,
    reports: Annotated[
        bool, typer.Option("--reports/--no-reports", help="Write the pages, or run the campaigns only.")
    ] = True,
    figures: Annotated[
        Path | None,
        typer.Option(help="A directory to write the paper's figures into as well, one file each."),
    ] = None,
    form: Form = None,
    json: Json = False,
) -> None:
    """Run a folder's campaigns and write the paper's figures; given again, go on where it ended."""
    from orchestrator.reproduction.listing import read_listing

    form = picture_form(form, figures)
    if figures is not None and not reports:
        raise InputError(f"--figures {figures} are those of the pages; leave out --no-reports, or --figures")
    listing = read_listing(folder, out, only=only or (), trials=trials, workers=jobs or cpus(), dask=dask)
    if reports:
        from orchestrator.report.page import require_libraries

        require_libraries()
    facts, code = _sweep(listing, json=json)
    told: dict[str, Any] = {"exit_code": code, "directory": str(listing.where), "campaigns": facts}
    if reports:
        index, pages, page = _report(listing, json=json)
        told |= {"index": str(index), "reports": [str(path) for path in pages]}
        if figures is not None:
            from orchestrator.report.export import export

            pictures = export(page.figures, figures, form)
            told["figures"] = [str(path) for path in pictures]
        if not json:
            _say_where(index, page, told.get("figures", []))
    if json:
        print_json(told)
    raise typer.Exit(code)


def _sweep(listing: Listing, *, json: bool) -> tuple[dict[str, Any], int]:
    """Carry out all campaigns; return what each came to, and the worst exit code."""
    facts, code = {}, exit_codes.PASSED
    for number, own in enumerate(listing.campaigns, start=1):
        if not json:
            about = f": {own.about}" if own.about else ""
            typer.echo(f"\n{own.name} ({number} of {len(listing.campaigns)}){about}")
        done = carry_out(own.campaign, json=json)
        facts[own.name] = done.facts()
        code = max(code, done.exit_code)
    return facts, code


def _report(listing: Listing, *, json: bool) -> tuple[Path, list[Path], Page]:
    """Write all pages; return the paper's file, the others, and the paper's page."""
    from orchestrator.reproduction.reports import write_index, write_reports

    if not json:
        typer.echo("")
    pages = []
    for path in write_reports(listing):
        pages.append(path)
        if not json:
            typer.echo(f"wrote {path}")
    index, page = write_index(listing)
    return index, pages, page


def _say_where(index: Path, page: Page, pictures: list[str]) -> None:
    for path in pictures:
        typer.echo(f"wrote {path}")
    typer.echo(f"\n{page.headline}\nall of it: {index}")
