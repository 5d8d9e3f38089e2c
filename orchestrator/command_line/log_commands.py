"""`gauntlet log`: look into a log, mend it, hand it on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orchestrator.choices import ExportFormat
from orchestrator.command_line.options import Json
from orchestrator.command_line.output import print_json
from orchestrator.run_directory import log_in

app = typer.Typer(help="Look into a log, mend a truncated one, hand its data on.", no_args_is_help=True)

LogFile = Annotated[
    Path,
    typer.Argument(
        metavar="LOG", help="A run's MCAP file, or its directory.", show_default=False, callback=log_in
    ),
]


@app.command()
def info(log: LogFile, json: Json = False) -> None:
    """Tell what a log holds: provenance, topics, size, whether it is whole."""
    from orchestrator.log.describe import describe, describe_lines

    facts = describe(log)
    if json:
        print_json(facts)
    else:
        typer.echo("\n".join(describe_lines(facts)))


@app.command()
def recover(
    log: LogFile,
    out: Annotated[
        Path | None, typer.Option(help="The file to write.", show_default="LOG.recovered.mcap")
    ] = None,
    json: Json = False,
) -> None:
    """Write a whole log from one that was cut off; the original is left as it is."""
    from orchestrator.log.recover import recover as recover_log

    recovery = recover_log(log, out)
    if json:
        print_json({**recovery._asdict(), "path": str(recovery.path)})
        return
    lost = f"; damaged chunks that are lost: {recovery.damaged_chunks}" if recovery.damaged_chunks else ""
    held = f"{recovery.messages} messages, {recovery.whole_steps} whole steps"
    typer.echo(f"wrote {recovery.path}: {held}{lost}")


@app.command()
def export(
    log: LogFile,
    out: Annotated[Path, typer.Option(help="The directory to write into.")],
    form: Annotated[
        ExportFormat,
        typer.Option("--format", help="CSV or Parquet tables, JSON lines or NumPy."),
    ] = "csv",
    json: Json = False,
) -> None:
    """Write a log's data as tables, JSON lines or arrays."""
    from orchestrator.handoff.export import export as export_log

    paths = [str(path) for path in export_log(log, form, out)]
    if json:
        print_json({"files": paths})
    else:
        typer.echo("\n".join(f"wrote {path}" for path in paths))
