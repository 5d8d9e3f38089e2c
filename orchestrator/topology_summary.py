"""A valid topology in a few lines, or as plain data."""

from __future__ import annotations

from collections import Counter
from typing import Any

from bus.grants import process_names
from orchestrator.advice import advice
from orchestrator.topology.resolved import Topology


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def summarise(topology: Topology) -> dict[str, Any]:
    """Return what a topology describes: plain data, ready for JSON."""
    plan = topology.plan
    return {
        "file": str(topology.path),
        "name": plan.name,
        "hash": topology.hash,
        "seed": plan.seed,
        "steps": plan.steps,
        "period_s": plan.period_s,
        "sensors": len(plan.sensors),
        "estimators": dict(Counter(own.kind.reference.rpartition(":")[2] for own in plan.estimators)),
        "links": len(plan.links),
        "stages": {stage.label: len(stage.streams) for stage in plan.stages},
        "processes": len(process_names(plan)) + 1,
        "expectations": len(topology.expectations),
        "warnings": [str(warning) for warning in topology.warnings],
        "advice": advice(plan),
    }


def summary_lines(summary: dict[str, Any]) -> list[str]:
    """Return a summary for people."""
    methods = ", ".join(f"{number} {name}" for name, number in summary["estimators"].items())
    lines = [
        f"{summary['file']}: {summary['name']} is valid",
        f"  {_count(summary['steps'], 'step')} of {summary['period_s']:g} s, seed {summary['seed']}, "
        f"{summary['processes']} processes, {_count(summary['expectations'], 'expectation')}",
        f"  {_count(summary['sensors'], 'sensor')}; estimators: {methods}; "
        f"{_count(summary['links'], 'link')}",
    ]
    lines += [f"  stage {label} on {_count(links, 'link')}" for label, links in summary["stages"].items()]
    lines += [f"  warning: {warning}" for warning in summary["warnings"]]
    return lines + [f"  {line}" for line in summary["advice"]]
