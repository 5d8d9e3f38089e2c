"""`gauntlet sweep`: a campaign of many trials of one topology, and of its variants."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from orchestrator import exit_codes
from orchestrator.command_line.campaign_output import print_summary, sweep_console, sweep_progress
from orchestrator.command_line.output import fail, print_json
from orchestrator.interrupts import Interrupted


def sweep(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A topology file (YAML).", show_default=False)],
    trials: Annotated[int, typer.Option(help="Trials of each variant.", min=1, show_default=False)],
    first_trial: Annotated[int, typer.Option(help="The number of the first trial.", min=0)] = 0,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", help="Worker processes. Default: one a CPU.", min=1, show_default=False),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=V1[,V2...]",
            help="Override a value; several values make variants. Repeatable: all combinations.",
        ),
    ] = None,
    twin: Annotated[
        bool, typer.Option("--twin", help="Run each variant without its attacks too: what do they cost?")
    ] = False,
    seed: Annotated[int | None, typer.Option(help="Override the topology's seed.", min=0)] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory of the campaign; given again, it goes on. Default: runs/NAME-seedSEED-sweep-N.",
            show_default=False,
        ),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Run on the Dask cluster of this scheduler, as in tcp://host:8786."
        ),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print JSON for programs instead of text for people.")
    ] = False,
) -> None:
    """Run a topology in many trials, and in variants; keep every figure of every trial in one file."""
    from orchestrator.backends.contract import RunFailedError
    from orchestrator.campaign.summary import summarise
    from orchestrator.campaign.sweep import Request, prepare
    from orchestrator.campaign.sweep import sweep as run_sweep

    given = tuple(overrides or ())
    request = Request(file, trials, first_trial, given, seed, out, jobs or _cpus(), dask, twin)
    campaign = prepare(request)
    for warning in campaign.warnings:
        typer.echo(f"warning: {warning}", err=True)
    try:
        with sweep_progress(quiet=json) as progress:
            directory = run_sweep(campaign, progress)
    except Interrupted:
        where = "the same --out" if out else "its directory as --out"
        typer.echo(f"the finished trials are kept; give the command again with {where} to go on", err=True)
        raise
    except RunFailedError as error:
        fail(str(error), exit_codes.RUN_FAILED)
    summary = summarise(directory)
    code = exit_codes.RUN_FAILED if summary.failed else exit_codes.PASSED
    if json:
        print_json({"directory": str(directory), "exit_code": code, **summary.facts()})
    else:
        print_summary(summary, sweep_console())
        typer.echo(f"results: {directory / 'results.parquet'}")
        typer.echo(f"one trial with its log: gauntlet replay {directory} --variant 0 --trial {first_trial}")
    raise typer.Exit(code)


def _cpus() -> int:
    """Return the number of CPUs that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)  # Linux only
    return len(affinity(0)) if affinity else os.cpu_count() or 1
