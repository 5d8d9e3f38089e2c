"""`gauntlet replay`: one trial of a campaign once more, alone and with its full log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from orchestrator import exit_codes
from orchestrator.choices import Backend
from orchestrator.command_line.launch import launch
from orchestrator.command_line.options import Json

if TYPE_CHECKING:
    from orchestrator.campaign.replay import Comparison


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
    found: list[Comparison] = []

    def compare(run: Path) -> dict[str, Any]:
        found.append(compared(directory, variant, topology, run))
        return {"campaign": found[0].facts()}

    report = launch(topology, chosen, where, json=json, beside=compare)
    (comparison,) = found
    typer.echo(comparison.message, err=True)
    is_over = report.exit_code in (exit_codes.PASSED, exit_codes.EXPECTATION_FAILED)
    raise typer.Exit((comparison.exit_code or report.exit_code) if is_over else report.exit_code)
