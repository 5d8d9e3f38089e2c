"""`gauntlet report`: a run, a campaign or a comparison as one offline HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orchestrator.choices import FigureFormat
from orchestrator.command_line.options import Json
from orchestrator.command_line.output import print_json
from orchestrator.errors import InputError

Form = Annotated[
    FigureFormat | None,
    typer.Option(
        "--format", help="The kind of picture that --figures writes. Default: svg.", show_default=False
    ),
]


def report(
    paths: Annotated[
        list[str],
        typer.Argument(
            metavar="PATH...",
            help="A run's directory or log, or a campaign's directory; 'DIR#2' or 'DIR#method=kalman' names "
            "variants of it. Several are compared.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(help="The HTML file to write.")] = Path("report.html"),
    by: Annotated[
        str | None,
        typer.Option(
            metavar="WHAT",
            help="Tell estimators apart by node or method, or not at all inside a variant, or inside a value "
            "of a path of --set. Default: by method and parameters.",
            show_default=False,
        ),
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="A directory to write the figures into as well, one file each.")
    ] = None,
    form: Form = None,
    json: Json = False,
) -> None:
    """Write one HTML page that needs no network: figures, verdicts, and where they come from."""
    from orchestrator.report.making import page_for
    from orchestrator.report.page import write_page

    form = picture_form(form, figures)
    page = page_for(paths, by)
    size = write_page(page, out)
    pictures: list[Path] = []
    if figures is not None:
        from orchestrator.report.export import export

        pictures = export(page.figures, figures, form)
    if json:
        print_json({"report": str(out), "bytes": size, "figures": [str(path) for path in pictures]})
        return
    typer.echo(f"wrote {out} ({size / 1e6:.1f} MB)")
    for path in pictures:
        typer.echo(f"wrote {path}")


def picture_form(asked: FigureFormat | None, figures: Path | None) -> FigureFormat:
    """Return the kind of picture to write; raises `InputError` where one is asked for and none is written."""
    if asked is not None and figures is None:
        raise InputError(
            f"--format {asked} is the kind of picture that --figures writes, and there is no --figures; "
            "add --figures DIR"
        )
    return asked or "svg"
