"""`gauntlet sweep`: a campaign of many trials of one topology, and of its variants."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from orchestrator import exit_codes
from orchestrator.command_line.campaign_output import print_summary, sweep_console, sweep_progress
from orchestrator.command_line.options import DaskAddress, Jobs, Json
from orchestrator.command_line.output import fail, print_json
from orchestrator.interrupts import Interrupted

if TYPE_CHECKING:
    from orchestrator.campaign.summary import Summary
    from orchestrator.campaign.sweep import Campaign


@dataclass(frozen=True)
class Done:
    """A campaign that was carried out: where it is, and what it came to."""

    directory: Path
    summary: Summary

    @property
    def exit_code(self) -> int:
        """Whether every trial was scored; what was expected of single runs is counted, and no matter here."""
        return exit_codes.RUN_FAILED if self.summary.failed else exit_codes.PASSED

    def facts(self) -> dict[str, Any]:
        """Return the whole as plain data, ready for JSON."""
        return {
            "directory": str(self.directory),
            "exit_code": self.exit_code,
            **self.summary.facts(),
        }


def sweep(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A topology file (YAML).", show_default=False)],
    trials: Annotated[int, typer.Option(help="Trials of each variant.", min=1, show_default=False)],
    first_trial: Annotated[int, typer.Option(help="The number of the first trial.", min=0)] = 0,
    jobs: Jobs = None,
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
    dask: DaskAddress = None,
    trial_timeout: Annotated[
        float,
        typer.Option(metavar="S", help="Give up a trial that takes a worker longer than this (s).", min=0.1),
    ] = 3600.0,
    json: Json = False,
) -> None:
    """Run a topology in many trials, and in variants; keep every figure of every trial in one file."""
    from orchestrator.campaign.sweep import Request, prepare

    given = tuple(overrides or ())
    cores = jobs or cpus()
    request = Request(file, trials, first_trial, given, seed, out, cores, dask, twin, trial_timeout)
    done = carry_out(prepare(request), json=json)
    if json:
        print_json(done.facts())
    else:
        variant, trial = next(
            ((own.variant, own.failed_trials[0]) for own in done.summary.tallies if own.failed),
            (0, first_trial),
        )
        chosen = f" --variant {variant}" if variant else ""
        folder = quote(str(done.directory))
        typer.echo(f"one trial with its log: gauntlet replay {folder}{chosen} --trial {trial}")
    raise typer.Exit(done.exit_code)


def carry_out(campaign: Campaign, *, json: bool) -> Done:
    """Run a campaign with progress, and print what it came to unless it is to be JSON."""
    from orchestrator.backends.contract import RunFailedError
    from orchestrator.campaign.summary import summarise
    from orchestrator.campaign.sweep import sweep as run_sweep

    for warning in campaign.warnings:
        typer.echo(f"warning: {warning}", err=True)
    try:
        with sweep_progress(quiet=json) as progress:
            directory = run_sweep(campaign, progress)
    except Interrupted:
        where = "the same --out" if campaign.request.out else "its directory as --out"
        typer.echo(f"the finished trials are kept; give the command again with {where} to go on", err=True)
        raise
    except RunFailedError as error:
        fail(str(error), exit_codes.RUN_FAILED)
    confidence = [own.topology.score_options.confidence for own in campaign.variants]
    done = Done(directory, summarise(directory, confidence))
    if not json:
        print_summary(done.summary, sweep_console())
        typer.echo(f"results: {directory / 'results.parquet'}")
    return done


def cpus() -> int:
    """Return the number of CPUs that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)  # Linux only
    return len(affinity(0)) if affinity else os.cpu_count() or 1
