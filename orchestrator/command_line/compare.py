"""`gauntlet compare`: is one better than the other, by how much, and how sure is that."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orchestrator.command_line.options import Json
from orchestrator.command_line.output import print_json, verdict_console

if TYPE_CHECKING:
    from orchestrator.evidence.comparison import Comparison

_USUAL = "rmse.position where all have it, else rmse.state"


def compare(
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="A [B...]",
            help="Logs, run directories or campaigns; 'DIR#2' or 'DIR#method=kalman' names a variant.",
            show_default=False,
        ),
    ],
    metrics: Annotated[
        list[str] | None,
        typer.Option("--metric", metavar="METRIC", help=f"What to compare. Repeatable. Default: {_USUAL}."),
    ] = None,
    by: Annotated[
        str | None,
        typer.Option(
            metavar="WHAT", help="Take each source apart by node, method, variant or a path of --set."
        ),
    ] = None,
    confidence: Annotated[
        float, typer.Option(help="Confidence of intervals and verdicts.", min=0.5, max=0.9999)
    ] = 0.95,
    margin: Annotated[
        float, typer.Option(help="Relative difference that is too small to matter.", min=0.0, max=1.0)
    ] = 0.05,
    out: Annotated[
        Path | None, typer.Option(help="Write the JSON into this file too.", show_default=False)
    ] = None,
    json: Json = False,
) -> None:
    """Compare estimators, runs or variants over common trials, and say which is better."""
    from orchestrator.evidence.chosen import choose
    from orchestrator.evidence.comparison import compare as compare_contenders
    from orchestrator.evidence.contenders import find_contenders, usual_metric
    from orchestrator.evidence.facts import facts

    chosen = list(map(choose, sources))
    for told in dict.fromkeys(told for own in chosen for told in own.source.unfinished):
        typer.echo(f"note: {told}", err=True)
    asked = list(dict.fromkeys(metrics or [usual_metric(chosen)]))
    contenders = find_contenders(chosen, by, asked)
    comparison = compare_contenders(contenders, asked, confidence, margin)
    if out is not None:
        _write(out, facts(comparison))
    if json:
        print_json(facts(comparison))
    else:
        _print(comparison)


def _write(path: Path, content: object) -> None:
    import msgspec

    from orchestrator.errors import InputError

    try:
        path.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n")
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}; choose another --out") from error


def _print(comparison: Comparison) -> None:
    from rich.table import Table

    from orchestrator.evidence.metrics import label
    from orchestrator.evidence.wording import figure, lines

    console = verdict_console()
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("contender", overflow="fold")
    table.add_column("trials", justify="right")
    for metric in comparison.metrics:
        table.add_column(f"median {label(metric)}", justify="right")
        if label(metric) != metric:
            table.add_column(f"median {metric}", justify="right")
    for i, contender in enumerate(comparison.contenders):
        own = [samples[i] for samples in comparison.samples]
        trials = str(max(sample.values.size + sample.undefined for sample in own))
        medians = []
        for metric, sample in zip(comparison.metrics, own, strict=True):
            medians.append(figure(sample.median))
            if label(metric) != metric:
                medians.append(figure(sample.plain_median))
        table.add_row(contender.name, trials, *medians)
    console.print(table)
    for line in lines(comparison):
        console.print()
        console.print(line, markup=False)
