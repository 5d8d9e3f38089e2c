"""Options that several commands have."""

from __future__ import annotations

from typing import Annotated

import typer

Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs instead of text for people.")]
Jobs = Annotated[
    int | None,
    typer.Option("--jobs", "-j", help="Worker processes. Default: one a CPU.", min=1, show_default=False),
]
DaskAddress = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Run on the Dask cluster of this scheduler, as in tcp://host:8786."),
]
