"""What attacks are on: links by pattern, the plant, or nodes."""

from __future__ import annotations

from collections.abc import Sequence

from orchestrator.topology.draft import Draft
from orchestrator.topology.names import matches
from orchestrator.topology.problems import PathKeys, did_you_mean
from orchestrator.topology.stages import DeclaredStage

PLANT_NAME = "plant"
ARROW = "->"


def senders(draft: Draft) -> list[str]:
    """Return the names of all nodes that send packets."""
    return [*draft.names("sensors"), *draft.names("estimators"), *draft.names("controllers")]


def as_link_pattern(pattern: str) -> str:
    """Return the pattern of links that is meant: a node stands for all links that leave it."""
    return pattern if ARROW in pattern else f"{pattern}{ARROW}*"


def links_of_pattern(pattern: str, links: Sequence[str]) -> list[str]:
    """Return the links (``a->b``) that fit a pattern of two sides, or of the sender alone."""
    left, _, right = as_link_pattern(pattern).partition(ARROW)
    ends = ((link, *link.split(ARROW)) for link in links)
    return [link for link, source, receiver in ends if matches(left, source) and matches(right, receiver)]


def check_sides(draft: Draft, pattern: str, path: PathKeys) -> None:
    """Note sides of a link pattern that name no node: this needs no graph, so it can be told early."""
    left, arrow, right = pattern.partition(ARROW)
    if not left or (arrow and not right) or ARROW in right:
        _complain_of_form(draft, pattern, path)
        return
    receivers = [*draft.names("estimators"), *([PLANT_NAME] if draft.names("controllers") else ())]
    sides = [(left, senders(draft), "sender")] + ([(right, receivers, "receiver")] if arrow else [])
    for side, names, what in sides:
        if not any(matches(side, name) for name in names):
            draft.complain(path, f"'{pattern}': there is no {what} '{side}'", did_you_mean(side, names))


def _complain_of_form(draft: Draft, pattern: str, path: PathKeys) -> None:
    draft.complain(path, f"'{pattern}' is not a link", "write s4->e4, or e*->e*")


def check_nodes(draft: Draft, pattern: str, path: PathKeys) -> None:
    """Note a pattern that names no node."""
    names = senders(draft)
    if not any(matches(pattern, name) for name in names):
        draft.complain(path, f"there is no node '{pattern}'", did_you_mean(pattern, names))


def check_targets(draft: Draft, attacks: Sequence[DeclaredStage]) -> None:
    """Note attacks, channels, controllers and seals that refer to nodes that there are not."""
    for stage in attacks:
        for index, pattern in enumerate(stage.on):
            _check_target(draft, stage, pattern, (*stage.path, "on", index))
        if stage.when is not None and stage.when.found.short_name == "alarm":
            _check_estimator(draft, str(stage.when.parameters["of"]), (*stage.path, "when", "alarm", "of"))
    for pattern in draft.sections.get("channel") or {}:
        if ARROW in pattern:
            check_sides(draft, pattern, ("channel", pattern))
        else:
            _complain_of_form(draft, pattern, ("channel", pattern))
    for pattern in draft.sections.get("integrity") or {}:
        check_nodes(draft, pattern, ("integrity", pattern))
    for name, own in (draft.sections.get("controllers") or {}).items():
        _check_estimator(draft, own.estimator, ("controllers", name, "estimator"))
    reference = getattr(draft.sections.get("score"), "reference", "")
    if reference:
        _check_estimator(draft, reference, ("score", "reference"))
    doomed = [pattern for stage in attacks if stage.role == "fault" for pattern in stage.on]
    if doomed and all(any(matches(pattern, name) for pattern in doomed) for name in senders(draft)):
        draft.complain(("attacks",), "every sender falls silent", "keep one that speaks to the end")
    names = draft.names("controllers")
    if len(names) > 1:
        draft.complain(("controllers", names[1]), "the plant has two controllers", "keep one")


def _check_target(draft: Draft, stage: DeclaredStage, pattern: str, path: PathKeys) -> None:
    kind = stage.checked.found.short_name
    if stage.role == "signal":
        if pattern != PLANT_NAME:
            draft.complain(path, f"{kind} enters the plant and its sensors", f"write 'on: {PLANT_NAME}'")
        if stage.when is not None and getattr(stage.when.found.type, "closed_loop", False):
            cure = "use a window, or the schedule periodic, bernoulli or markov"
            draft.complain(path, f"{kind} cannot wait for a trigger: plant and sensors act at once", cure)
    elif stage.role == "fault":
        check_nodes(draft, pattern, path)
        if stage.when is not None or len(stage.windows) > 1:
            draft.complain(path, f"{kind} lasts to the end of the run", "give 'steps: [first, last]' alone")
    else:
        check_sides(draft, pattern, path)


def _check_estimator(draft: Draft, name: str, path: PathKeys) -> None:
    names = draft.names("estimators")
    if name not in names:
        draft.complain(path, f"there is no estimator '{name}'", did_you_mean(name, names))
