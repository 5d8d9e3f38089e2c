"""`gauntlet replay`: one trial of a campaign once more, alone and with its full log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orchestrator.choices import Backend
from orchestrator.command_line.launch import launch
from orchestrator.command_line.options import Json


def replay(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="The directory of a campaign.", show_default=False)
    ],
    trial: Annotated[int, typer.Option(help="The number of the trial.", min=0, show_default=False)],
    variant: Annotated[int, typer.Option(help="The number of the variant.", min=0)] = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory of the run. Default: DIR/replays/variant-V-trial-T-N.", show_default=False
        ),
    ] = None,
    backend: Annotated[
        Backend | None,
        typer.Option(
            help="One process a node, or all in one; the log is the same. Default: the topology's.",
            show_default=False,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Run one trial of a campaign again, with its log, and compare its score with the campaign's row."""
    from orchestrator.campaign.replay import compared, directory_of_replay, topology_of_trial
    from orchestrator.quick_start import load_to_run

    file = topology_of_trial(directory, variant)
    topology, chosen = load_to_run(file, [f"trial={trial}"], None, backend)
    where = out or directory_of_replay(directory, variant, trial)
    report = launch(topology, chosen, where, json=json)
    typer.echo(compared(directory, variant, trial, report.directory), err=True)
    raise typer.Exit(report.exit_code)
