"""Whether topology files are valid, many at once, without running them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orchestrator.topology.load import find_problems, is_base, load_topology
from orchestrator.topology.problems import Problem, TopologyError
from orchestrator.topology_summary import summarise, summary_lines


@dataclass(frozen=True)
class Validation:
    """What became of several files: summaries of the valid ones, and everything wrong with the others."""

    summaries: tuple[dict[str, Any], ...]
    bases: tuple[dict[str, Any], ...]
    problems: tuple[Problem, ...]

    def facts(self) -> dict[str, Any]:
        """Return the whole as plain data, ready for JSON."""
        return {
            "valid": not self.problems,
            "topologies": self.summaries,
            "bases": self.bases,
            "problems": [problem.as_json() for problem in self.problems],
        }

    def lines(self) -> list[str]:
        """Return what is valid, for people."""
        lines = [line for summary in self.summaries for line in summary_lines(summary)]
        for base in self.bases:
            lines.append(f"{base['file']}: is a base, and sound; what extends it is checked as a whole")
            lines += [f"  warning: {warning}" for warning in base["warnings"]]
        return lines


def validate(files: Iterable[Path], overrides: Iterable[str] = (), seed: int | None = None) -> Validation:
    """Check topology files; a base may leave out what its heirs must say, and a mistake is told once."""
    summaries, bases = [], []
    problems: list[Problem] = []
    changes = list(overrides)
    for file in files:
        try:
            if is_base(file):
                errors, warnings = find_problems(file, changes)
                problems += errors
                if not errors:
                    bases.append({"file": str(file), "warnings": [str(warning) for warning in warnings]})
            else:
                summaries.append(summarise(load_topology(file, changes, seed)))
        except TopologyError as error:
            problems += error.problems
    return Validation(tuple(summaries), tuple(bases), tuple(dict.fromkeys(problems)))
