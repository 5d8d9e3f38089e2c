"""`gauntlet fit`: the parameters of a Gilbert-Elliott channel from recorded losses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orchestrator.command_line.options import Json
from orchestrator.command_line.output import print_json


def fit(
    losses: Annotated[
        Path,
        typer.Argument(metavar="LOSSES", help="0 and 1 as text, 1 for lost, or a run's MCAP file."),
    ],
    link: Annotated[
        str | None, typer.Option(help="Of a run: the link whose losses to fit, as in 's4->e4'.")
    ] = None,
    json: Json = False,
) -> None:
    """Fit a Gilbert-Elliott channel to recorded losses, and print it as a topology states it."""
    from orchestrator.loss_traces import fits, read_losses

    found = fits(read_losses(losses, link))
    if json:
        print_json(found.facts())
    else:
        typer.echo("\n".join(found.lines()))
