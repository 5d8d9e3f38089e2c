"""The commands of `gauntlet`, and how their errors become exit codes."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orchestrator import exit_codes
from orchestrator.choices import Backend
from orchestrator.command_line import log_commands
from orchestrator.command_line.compare import compare
from orchestrator.command_line.fit import fit
from orchestrator.command_line.launch import launch
from orchestrator.command_line.options import Json
from orchestrator.command_line.output import (
    fail,
    outlive_readers,
    print_json,
    verdict_console,
)
from orchestrator.command_line.replay import replay
from orchestrator.command_line.report import report
from orchestrator.command_line.reproduce import reproduce
from orchestrator.command_line.sweep import sweep
from orchestrator.command_line.test import run_tests
from orchestrator.errors import InputError
from orchestrator.interrupts import Interrupted, raising_interrupts
from orchestrator.run_directory import log_in

if TYPE_CHECKING:
    from orchestrator.topology.resolved import Topology

os.environ.update(
    OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1"
)  # before numpy is imported

_EPILOG = (
    "Exit codes: 0 passed, 1 an expectation failed, 2 bad input, "
    "3 a node failed or the log could not be written, 130/143 interrupted."
)

app = typer.Typer(
    name="gauntlet",
    help="Run state estimators through a hostile network, and tell which ones survive.",
    epilog=_EPILOG,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(log_commands.app, name="log")
app.command()(fit)
app.command()(sweep)
app.command()(compare)
app.command()(replay)
app.command()(reproduce)
app.command("test")(run_tests)
app.command()(report)

TopologyFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="A topology file (YAML).", show_default=False)
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Override a value, as in sensors.s4.noise.std=0.1. Repeatable."
    ),
]
Seed = Annotated[int | None, typer.Option(help="Override the topology's seed.", min=0)]


@app.callback(invoke_without_command=True)
def _main(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        from importlib.metadata import PackageNotFoundError
        from importlib.metadata import version as version_of

        try:
            typer.echo(f"gauntlet {version_of('gauntlet')}")
        except PackageNotFoundError:
            typer.echo("gauntlet, run from its source without being installed")
        raise typer.Exit


@app.command()
def run(
    file: TopologyFile,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory for log, score and node logs. Default: runs/NAME-seedSEED-N.", show_default=False
        ),
    ] = None,
    seed: Seed = None,
    overrides: Overrides = None,
    backend: Annotated[
        Backend | None,
        typer.Option(
            help="One process a node, or all in this one; the log is the same. Default: the file's.",
            show_default=False,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Launch a topology, log every message, score the estimators and print the verdict."""
    from orchestrator.quick_start import load_to_run

    topology, chosen = load_to_run(file, overrides or (), seed, backend)
    report = launch(topology, chosen, out, json=json)
    raise typer.Exit(report.exit_code)


@app.command()
def validate(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", show_default=False)],
    seed: Seed = None,
    overrides: Overrides = None,
    json: Json = False,
) -> None:
    """Check topology files without running them: all errors at once, with file, line and cure."""
    from orchestrator.validation import validate as validate_files

    found = validate_files(files, overrides or (), seed)
    if json:
        print_json(found.facts())
    else:
        if lines := found.lines():
            typer.echo("\n".join(lines))
        for problem in found.problems:
            typer.echo(str(problem), err=True)
    raise typer.Exit(exit_codes.BAD_INPUT if found.problems else exit_codes.PASSED)


@app.command()
def score(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG",
            help="A run's MCAP file, whole or cut off, or its directory.",
            show_default=False,
            callback=log_in,
        ),
    ],
    json: Json = False,
) -> None:
    """Compute the score of a log again, from nothing but the log."""
    from orchestrator.score_of_log import score_of_log

    result = score_of_log(log)
    if json:
        sys.stdout.buffer.write(result.to_json())
    else:
        from orchestrator.score.verdict import print_verdict

        print_verdict(result, verdict_console())
    raise typer.Exit(exit_codes.PASSED if result.passed else exit_codes.EXPECTATION_FAILED)


@app.command()
def graph(
    file: TopologyFile,
    out: Annotated[
        Path, typer.Option(help="The picture to write; its ending chooses SVG, PNG or PDF.")
    ] = Path("network.svg"),
    seed: Seed = None,
    overrides: Overrides = None,
) -> None:
    """Draw the network: who measures, who listens to whom, what is lossy and what is attacked."""
    from orchestrator.graph_drawing import draw

    draw(_load(file, overrides, seed).plan, out)
    typer.echo(f"wrote {out}")


@app.command()
def schema() -> None:
    """Print the JSON Schema of topology files, for editors."""
    from orchestrator.topology.json_schema import schema as topology_schema

    print_json(topology_schema())


@app.command()
def plugins(json: Json = False) -> None:
    """List every kind that a topology may name: plants, sensors, estimators, impairments, attacks, graphs."""
    from orchestrator.registry import describe_kinds

    kinds = describe_kinds()
    if json:
        print_json(kinds)
        return
    for kind in kinds:
        typer.echo(f"{kind['role']:<11} {kind['name']:<22} {kind['summary']}")


def _load(file: Path, overrides: list[str] | None, seed: int | None) -> Topology:
    from orchestrator.topology.load import load_topology

    return load_topology(file, overrides or (), seed)


def main() -> None:
    """Run the command line; errors that are the user's to mend end with one clear text and exit code 2."""
    outlive_readers()
    try:
        with raising_interrupts():
            app(prog_name="gauntlet")
    except Interrupted as interrupt:
        fail(f"interrupted by {interrupt}", interrupt.exit_code)
    except InputError as error:
        fail(error)


if __name__ == "__main__":
    main()
