"""Measure what Gauntlet costs beside bare Zenoh, HELICS and mosaik.

python -m benchmarks            all rows
python -m benchmarks a c e      some of them
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

os.environ.update(
    OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1"
)  # before numpy is imported

from rich.console import Console

from benchmarks import campaigns, ding, growth, methods, packets, ring
from benchmarks.comparison import Comparison
from benchmarks.effort import Effort
from benchmarks.table import machine, markdown, print_table

GROUPS = (("abcd", ding), ("e", ring), ("f", growth), ("g", methods), ("h", packets), ("i", campaigns))
ROWS = "".join(letters for letters, _ in GROUPS)

_EPILOG = """\
rows:
  a  rate and CPU of the Ding network in processes, against bare Zenoh
  b  its start-up
  c  the same in one process
  d  memory a process
  e  a ring with feedback each step, against HELICS and mosaik
  f  growth over 10, 20, 40, 80 nodes
  g  what a node's step costs, in a large network and by method
  h  packets a second through the channel
  i  trials of a campaign, and how much of a worker's time is mathematics"""


def row(letter: str) -> str:
    """Return a row's letter; raises the error of a command line for anything else."""
    if letter not in list(ROWS):
        raise argparse.ArgumentTypeError(f"there is no row {letter!r}; choose from a to {ROWS[-1]}")
    return letter


def parse(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Read the command line, or the arguments given."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Measure what Gauntlet costs.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("rows", nargs="*", type=row, metavar="ROW", help="a to i; default: all")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="runs of everything; default: 5")
    parser.add_argument("--quick", action="store_true", help="2 short runs: to see that it works")
    parser.add_argument("--timeout", type=float, default=180.0, metavar="S", help="bound of every run (s)")
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print JSON, with every sample")
    output.add_argument("--markdown", action="store_true", help="print the table for docs/benchmarks.md")
    return parser.parse_args(arguments)


def main() -> None:
    """Measure the rows that are asked for and print them; what is not as wanted is no error."""
    asked = parse()
    if not Path("/proc/self/smaps_rollup").exists():
        sys.exit("the benchmarks read what processes use from /proc: they need Linux")
    rows = frozenset(asked.rows or ROWS)
    errors = Console(stderr=True)
    with errors.status("starting") as status:
        repeats, scale = (2, 0.25) if asked.quick else (asked.repeats, 1.0)
        tell = status.update if errors.is_terminal else errors.print
        effort = Effort(repeats, scale, asked.timeout, tell)
        comparisons: list[Comparison] = []
        for letters, group in GROUPS:
            wanted = rows & frozenset(letters)
            if wanted:
                comparisons += group.measure(wanted, effort)
    if asked.json:
        facts = [comparison.facts() for comparison in comparisons]
        sys.stdout.write(
            json.dumps({"machine": machine(), "repeats": repeats, "rows": facts}, indent=2) + "\n"
        )
    elif asked.markdown:
        sys.stdout.write(markdown(comparisons, repeats))
    else:
        print_table(comparisons, repeats)


if __name__ == "__main__":
    main()
