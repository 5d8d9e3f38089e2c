"""What is chosen by a word, on the command line, in topology files and from Python alike.

It imports nothing, so that the command line is there at once.
"""

from __future__ import annotations

from typing import Literal

Backend = Literal["processes", "inprocess"]
"""Who carries out a run: one process a node, or this one alone; the log is the same."""

FigureFormat = Literal["svg", "png"]
"""The kind of picture that figures are written as."""

ExportFormat = Literal["csv", "jsonl", "npz", "parquet"]
"""The kind of file that a log's data is written as."""
