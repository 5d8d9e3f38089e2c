"""`gauntlet reproduce`: all campaigns of a paper's folder, by one command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orchestrator import exit_codes
from orchestrator.command_line.output import print_json
from orchestrator.command_line.sweep import DaskAddress, Jobs, Json, carry_out, cpus


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
        typer.Option(help="Where the campaigns go. Default: runs/reproduce/FOLDER.", show_default=False),
    ] = None,
    dask: DaskAddress = None,
    json: Json = False,
) -> None:
    """Run the campaigns that a folder lists; given again, go on where it ended."""
    from orchestrator.campaign.reproduce import listed_campaigns

    listed = listed_campaigns(folder, out, only=only or (), trials=trials, workers=jobs or cpus(), dask=dask)
    facts, code = {}, exit_codes.PASSED
    for own in listed:
        if not json:
            typer.echo(f"\n{own.name}: {own.about}" if own.about else f"\n{own.name}")
        done = carry_out(own.campaign, json=json)
        facts[own.name] = done.facts()
        code = max(code, done.exit_code)
    if json:
        print_json({"exit_code": code, "campaigns": facts})
    raise typer.Exit(code)
