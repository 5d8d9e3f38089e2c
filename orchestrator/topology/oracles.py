"""Oracles: which estimators the topology lets see what attacks add to their measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from nodes.contract import Estimator
from orchestrator.topology.draft import Draft
from orchestrator.topology.names import matches, select
from orchestrator.topology.placement import PlacedStage
from orchestrator.topology.problems import PathKeys, did_you_mean
from orchestrator.topology.targets import ARROW

Grants = dict[str, dict[str, PathKeys]]
"""By estimator: the patterns of attacks that it may see, each with its place in the file."""


def granted_patterns(draft: Draft) -> Grants:
    """Return who may see what, as the topology says it; names of no estimator are noted."""
    estimators = draft.names("estimators")
    grants: Grants = {}
    for pattern, attacks in (draft.sections.get("oracles") or {}).items():
        path: PathKeys = ("oracles", pattern)
        names = select(pattern, estimators)
        if not names:
            draft.complain(path, f"there is no estimator '{pattern}'", did_you_mean(pattern, estimators))
        for name in names:
            grants.setdefault(name, {}).update(
                {attack: (*path, index) for index, attack in enumerate(attacks)}
            )
    return {name: patterns for name, patterns in grants.items() if patterns}


def check_listeners(draft: Draft, grants: Grants, built: Mapping[str, Estimator | None]) -> None:
    """Note estimators that would not listen to the oracle that they are granted."""
    for name, patterns in grants.items():
        if built[name] is not None and not getattr(built[name], "takes_oracles", False):
            path = next(iter(patterns.values()))[:2]
            cure = "take it out, or use a method that listens: particle_fdi with 'attack_estimate: oracle'"
            draft.complain(path, f"{name} makes no use of an oracle", cure)


def oracles_of(
    draft: Draft, grants: Grants, placed: Sequence[PlacedStage], listens: Mapping[str, Sequence[str]]
) -> dict[str, tuple[str, ...]]:
    """Return, by estimator, the labels of the stages on its measurements of which it is told.

    Each window of an attack is a stage of its own. Noted are patterns that fit no such attack, and attacks
    whose kinds cannot tell what they add (they do not declare ``reveals``).
    """
    found: dict[str, tuple[str, ...]] = {}
    for name, patterns in grants.items():
        own = {f"{sensor}{ARROW}{name}" for sensor in listens[name]}
        kinds = {
            stage.plan.label: stage.declared.checked.found
            for stage in placed
            if stage.declared.role == "attack" and own.intersection(stage.plan.streams)
        }
        chosen: list[str] = []
        for pattern, path in patterns.items():
            fitting = [label for label in kinds if is_meant(pattern, label)]
            if not fitting:
                known = list(dict.fromkeys(map(attack_of, kinds)))
                cure = f"there are: {', '.join(known)}" if known else "take it out"
                draft.complain(path, f"no attack '{pattern}' is on the measurements of {name}", cure)
            mute = [label for label in fitting if not getattr(kinds[label].type, "reveals", False)]
            for label in mute[:1]:
                cure = "an oracle tells of bias, constant, converging_bias and drift"
                draft.complain(path, f"{kinds[label].short_name} cannot tell what it adds", cure)
            chosen += fitting
        found[name] = tuple(label for label in kinds if label in chosen)
    return found


def attack_of(label: str) -> str:
    """Return the label of the attack that a stage is a window of."""
    return label.partition("/")[0]


def is_meant(pattern: str, label: str) -> bool:
    """Tell whether a pattern fits the attack that a stage belongs to."""
    attack = attack_of(label)
    return pattern == attack or matches(pattern, attack)
