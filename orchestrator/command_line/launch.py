"""One run as a command carries it out: progress, verdict, and what it says at the end."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from orchestrator import exit_codes
from orchestrator.command_line.output import fail, print_json, run_progress, verdict_console

if TYPE_CHECKING:
    from orchestrator.choices import Backend
    from orchestrator.run import RunReport
    from orchestrator.topology.resolved import Topology


def launch(
    topology: Topology,
    backend: Backend,
    out: Path | None,
    *,
    json: bool,
    beside: Callable[[Path], Mapping[str, object]] | None = None,
) -> RunReport:
    """Run a topology, print the verdict, and return the report.

    Of a command that has more to say of the run, ``beside`` takes the run's directory and returns what stands
    beside the report in its JSON.
    """
    from orchestrator.run import NotBegunError, run_topology
    from orchestrator.run_directory import make_run_directory

    for warning in topology.warnings:
        typer.echo(f"warning: {warning}", err=True)
    directory = make_run_directory(out, topology.plan.name, topology.plan.seed)
    try:
        with run_progress(topology.plan.steps, quiet=json) as progress:
            report = run_topology(topology, directory, backend, progress)
    except NotBegunError as error:
        fail(error, exit_codes.RUN_FAILED)
    more = beside(report.directory) if beside is not None else {}
    if json:
        print_json({**report.facts(), **more})
    else:
        from orchestrator.score.verdict import print_verdict

        print_verdict(report.score, verdict_console(), timing=report.timing.headlines(), files=report.files())
    if report.message:
        typer.echo(f"gauntlet: {report.message}", err=True)
    return report
