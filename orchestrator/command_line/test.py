"""`gauntlet test`: every expectation of every topology file, for people and for continuous integration."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orchestrator.choices import Backend
from orchestrator.command_line.output import fail

if TYPE_CHECKING:
    from orchestrator.testing.suite import FileResult


def run_tests(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="PATH...", help="Topology files, or folders of them.", show_default=False),
    ],
    junit: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write JUnit XML as well.", show_default=False)
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, help="Files that run at a time.")] = 1,
    pattern: Annotated[
        str, typer.Option("-k", metavar="PATTERN", help="Only files with this in their path.")
    ] = "",
    seed: Annotated[
        int | None, typer.Option(min=0, help="Run every file at this seed.", show_default="each file's own")
    ] = None,
    backend: Annotated[Backend, typer.Option(help="One process a node, or all in one.")] = "inprocess",
    logs: Annotated[
        Path | None,
        typer.Option(help="Where logs of failing files are kept.", show_default="a new temporary folder"),
    ] = None,
) -> None:
    """Run topology files and check everything that they expect; `_*.yaml` in folders are bases, no tests."""
    from orchestrator.exit_codes import RUN_FAILED
    from orchestrator.interrupts import UNINTERRUPTED, Interrupted
    from orchestrator.testing.finding import find_files
    from orchestrator.testing.suite import Options, exit_code, run_files

    files = find_files(paths, pattern)
    kept = logs or Path(tempfile.mkdtemp(prefix="gauntlet-test-"))
    results = run_files(files, Options(kept, backend, seed), jobs, _tell)
    with UNINTERRUPTED:
        if logs is None and not any(kept.iterdir()):
            kept.rmdir()
        typer.echo(_summary(results))
        if junit is not None:
            _write(junit, results)
    code = exit_code(results)
    if code > RUN_FAILED:
        raise Interrupted(code - 128)
    raise typer.Exit(code)


def _write(path: Path, results: list[FileResult]) -> None:
    from orchestrator.testing.junit import junit_xml

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(junit_xml(results))
    except OSError as error:
        fail(f"{path} cannot be written: {error.strerror}; choose another --junit")


def _tell(result: FileResult) -> None:
    typer.echo("\n".join(_lines(result)))


def _lines(result: FileResult) -> list[str]:
    """Tell of one file: a line when all is well, else what went wrong and where to look."""
    log = [f"    log: {result.log}"] if result.log else []
    took = f"({result.seconds:.1f} s)"
    if result.error:
        detail = [f"    {line}" for line in (result.error + "\n" + result.detail).rstrip().splitlines()]
        return [f"! {result.path}: no verdict {took}", *detail, *log]
    if not result.cases:
        return [f"- {result.path}: it states no expectation"]
    if not result.failures:
        return [f"✓ {result.path}: {len(result.cases)} held {took}"]
    failed = [f"    {case.message}" for case in result.failures]
    return [f"✗ {result.path}: {len(failed)} of {len(result.cases)} failed {took}", *failed, *log]


def _summary(results: list[FileResult]) -> str:
    cases = sum(len(result.cases) for result in results)
    failed = sum(len(result.failures) for result in results)
    errors = sum(bool(result.error) for result in results)
    without = sum(not result.cases and not result.error for result in results)
    whole = f"{_count(len(results), 'file')}, {_count(cases, 'expectation')}"
    told = [f"{whole}: {cases - failed} held, {failed} failed"]
    told += [f"{errors} came to no verdict"] if errors else []
    told += [f"{without} state none"] if without else []
    return "; ".join(told) + f" ({sum(result.seconds for result in results):.1f} s of runs)"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
