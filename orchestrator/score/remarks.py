"""What is said of estimators and of attacks, in the same words on a terminal and on a page."""

from __future__ import annotations

from orchestrator.score.headline import several
from orchestrator.score.link_results import AttackWindow, Confusion
from orchestrator.score.measure import expected_estimates
from orchestrator.score.results import NodeScore, Score


def remarks(node: NodeScore, score: Score) -> list[str]:
    """Return what is out of the ordinary about an estimator, the gravest first."""
    parts = [f"PRIVILEGED: told of {', '.join(node.privileged)}"] if node.privileged else []
    if node.divergence_step is not None:
        parts.append(f"diverged at {node.divergence_step}")
    if node.silent_from is not None:
        parts.append(f"silent from {node.silent_from}")
    if not node.complete:
        parts.append(f"only {node.steps_scored} of {expected_estimates(score, node)} steps")
    parts += [f"deaf from {lockout.first_step}" for lockout in score.lockouts if lockout.node == node.name]
    if node.attacked_steps:
        parts.append(f"attacked {several(node.attacked_steps, 'step')}")
    if node.bound.guaranteed is not None and node.bound.outside is not None:
        kind = "guaranteed bound" if node.bound.guaranteed else "bound"
        parts.append(f"{kind} left {100 * node.bound.outside:.3g} %")
    return parts


def rejected(window: AttackWindow) -> str:
    """Return how many of an attack's packets a detector rejected."""
    return f"{window.rejected} of {window.packets}" if window.judged else "-"


def false_alarms(judged: Confusion | None) -> str:
    """Return how many genuine packets of a link were rejected; ``-`` where nobody judged them."""
    if judged is None:
        return "-"
    return f"{judged.false_positive} of {judged.false_positive + judged.true_negative}"


def alarm_after(window: AttackWindow) -> str:
    """Return how long an attack went unseen."""
    if not window.judged:
        return "no detector"
    if window.delay is None:
        return "undecided" if window.censored else "missed"
    return several(window.delay, "step")


def trusted_after(window: AttackWindow, score: Score) -> str:
    """Return how long genuine packets were rejected after an attack; ``-`` where the run ended with it."""
    if not window.judged:
        return ""
    if window.release is not None:
        return several(window.release, "step")
    return "-" if window.last >= score.steps - 1 else "never"
