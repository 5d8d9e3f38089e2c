"""A topology that is ready to run, or that a log holds."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bus.plan import Plan
from orchestrator.backends.contract import RunSettings
from orchestrator.choices import Backend
from orchestrator.score.expectation import Expectation
from orchestrator.score.results import ScoreOptions
from orchestrator.topology.problems import Problem
from orchestrator.topology.resolve import experiment_document
from orchestrator.topology.yaml_text import yaml_text


@dataclasses.dataclass(frozen=True)
class Topology:
    """A topology with everything resolved.

    Parameters
    ----------
    path
        The file that it was read from.
    plan
        What every process is told.
    state_groups
        Names for parts of the plant's state, by index.
    expectations, score_options
        What the score is held against, and how it counts.
    settings, backend
        How the run is carried out; no part of the experiment.
    warnings
        What is likely a mistake and still can be run.
    document
        The resolved topology as plain data, in the schema of topology files.
    """

    path: Path
    plan: Plan
    state_groups: Mapping[str, tuple[int, ...]]
    expectations: tuple[Expectation, ...]
    score_options: ScoreOptions
    settings: RunSettings
    backend: Backend
    warnings: tuple[Problem, ...]
    document: Mapping[str, Any]

    @property
    def name(self) -> str:
        """The name of the run."""
        return self.plan.name

    def at(self, *, seed: int | None = None, trial: int | None = None) -> Topology:
        """Return the same topology at another seed or trial, without reading it again."""
        seed = self.plan.seed if seed is None else seed
        trial = self.plan.trial if trial is None else trial
        plan = dataclasses.replace(self.plan, seed=seed, trial=trial)
        return dataclasses.replace(self, plan=plan, document={**self.document, "seed": seed, "trial": trial})

    def resolved_yaml(self) -> str:
        """Return a topology file with nothing left to defaults, bases, ranges or generators.

        Running it gives the same plan and the same log. A user's own classes stand in it by the absolute
        paths of their files.
        """
        comment = f"# Resolved from {self.path.name}: running this file gives the same log.\n"
        return comment + yaml_text(self.document)

    def experiment_json(self) -> bytes:
        """Return the experiment as canonical JSON: what the log holds, and what `hash` is the hash of.

        ``topology`` is the resolved topology without prose, process settings and paths; beside it stands what
        only the classes know: the plant's ``state_groups`` and each estimator's exchange ``rounds``.
        """
        return self._experiment

    @functools.cached_property
    def _experiment(self) -> bytes:
        content = {
            "topology": experiment_document(self.document),
            "state_groups": self.state_groups,
            "rounds": {estimator.name: estimator.rounds for estimator in self.plan.estimators},
        }
        return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()

    @property
    def hash(self) -> str:
        """SHA-256 of the experiment, seed and trial included."""
        return hashlib.sha256(self._experiment).hexdigest()
