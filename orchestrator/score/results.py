"""What a score holds: plain values, with None where a figure is undefined.

Steps are integers of the plan. A *group* is a part of the state that the plant names (``position``), or
``state``, which is all of it. Errors are in the units of the state's components.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from orchestrator.score.canonical_json import canonical_json
from orchestrator.score.link_results import (
    AttackWindow,
    Confusion,
    LinkScore,
    Lockout,
    SenderScore,
    Traffic,
)


@dataclass(frozen=True)
class ScoreOptions:
    """What the score may be told; none of it changes the run.

    Parameters
    ----------
    from_step
        First step that counts in averages of estimation errors (RMSE, NEES, NIS, disagreement).
    lockout_length
        Packets that a detector must reject in a row, up to the end, to be called locked out.
    divergence_bound
        Norm of the error of the whole state above which an estimator has diverged.
    confidence
        Probability of the two-sided chi-square bounds on NEES and NIS.
    detection_grace
        Steps after a window's last attacked packet in which an alarm still counts as its detection.
    reference
        Name of an estimator from which the deviation of all others is taken; empty for none.
    node_series
        Keep the error of every node at every step, not only the networks' averages.
    """

    from_step: int = 0
    lockout_length: int = 10
    divergence_bound: float = 1e6
    confidence: float = 0.95
    detection_grace: int = 0
    node_series: bool = False
    reference: str = ""

    def __post_init__(self) -> None:
        """Refuse values that no score can be made with; raises ValueError."""
        if self.from_step < 0 or self.detection_grace < 0 or self.lockout_length < 1:
            raise ValueError("from_step and detection_grace must be at least 0, lockout_length at least 1")
        if not self.divergence_bound > 0.0 or not 0.0 < self.confidence < 1.0:
            raise ValueError("divergence_bound must be positive and confidence between 0 and 1")


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """Base of what a score holds of estimators, and of the whole."""


class GroupError(Result, frozen=True, kw_only=True):
    """Errors of one estimator in one state group: Euclidean over the group, root mean square over steps.

    ``attacked`` and ``unattacked`` split the steps by whether an attacked packet reached this node. ``peak``
    is the largest error norm, ``final`` that of the last estimate about a step of the run. Each is None for
    an estimator that diverged, and over no step.
    """

    rmse: float | None
    attacked: float | None
    unattacked: float | None
    peak: float | None
    final: float | None = None


class Consistency(Result, frozen=True, kw_only=True):
    """Mean of a chi-square figure over ``samples`` steps, and what a consistent filter would show.

    ``dof`` is the mean's expectation (degrees of freedom a sample). ``low`` and ``high`` bound the mean at
    the options' confidence *if the samples were independent*. ``inside`` is the share of samples within their
    own bounds.
    """

    samples: int
    mean: float | None
    dof: float | None
    low: float | None
    high: float | None
    inside: float | None


class SignalWindow(Result, frozen=True, kw_only=True):
    """One signal attack, from the ``first`` to the ``last`` step in a row in which the signal was not zero.

    ``detection_delay`` counts the steps from ``first`` to the first publication that calls a step of the
    window attacked, ``release_delay`` those from the step after ``last`` to the first one that calls a later
    step, before the next window, free of attack; None when there is none. ``statements`` and
    ``statements_after`` count what was published about the steps of either kind.
    """

    first: int
    last: int
    statements: int
    statements_after: int
    detection_delay: int | None
    release_delay: int | None


class AttackScore(Result, frozen=True, kw_only=True):
    """What one estimator knew of the signal attacks; None where it does not say.

    ``probability_on`` and ``probability_off`` are its mean attack probability over steps with and without an
    attack. ``false_alarms`` and ``misses`` count the steps without and with one on which it was wrong.
    ``rmse`` is the error of its estimate of the signal while there is one: Euclidean over the components,
    root mean square over steps.
    """

    probability_on: float | None
    probability_off: float | None
    false_alarms: int | None
    misses: int | None
    rmse: float | None
    windows: list[SignalWindow]


class Deviation(Result, frozen=True, kw_only=True):
    """The distance from the estimates of a ``reference``, as two ways of normalising it have it.

    With the difference ``d_k`` (n,) in each of T steps, ``component_rms`` is ``sqrt(sum |d_k|^2 / n T)``, and
    ``norm_over_steps`` is ``sqrt(sum |d_k|^2) / T``.
    """

    reference: str
    component_rms: float
    norm_over_steps: float


class Bound(Result, frozen=True, kw_only=True):
    """What an estimator's covariance is worth as a bound of its error.

    ``outside`` is the share of steps whose NEES exceeds n, the size of the state: where the error leaves the
    ellipsoid ``e' P^-1 e <= n``. ``guaranteed`` is the method's own word that its covariance bounds the
    error's second moment whatever the adversary does within what it assumes; None when it says nothing.
    """

    outside: float | None
    guaranteed: bool | None


class NodeScore(Result, frozen=True, kw_only=True):
    """One estimator; ``method`` is the name of its class, ``divergence_step`` None when it never diverged.

    ``steps_scored`` counts published estimates, and ``complete`` says that none is missing. ``silent_from``
    is the step from which on the node may be silent (a crash or a hang of the topology, or a death that the
    others were to outlive), None when it may not.
    ``attacked_steps`` counts steps in which an attacked packet reached it, or an attack the
    plant. ``nees_undefined`` counts
    estimates, from `from_step` on and before any divergence, whose covariance is absent or not positive
    definite. ``error`` holds the error norms by group and step (only with `ScoreOptions.node_series`).
    ``attack`` is None for an estimator that says nothing of signal attacks.
    ``deviation`` is that from the reference, None without one.
    ``privileged`` names the attacks whose values an oracle tells it; of an honest estimator it is empty.
    """

    name: str
    method: str
    complete: bool
    silent_from: int | None
    steps_scored: int
    divergence_step: int | None
    attacked_steps: int
    groups: dict[str, GroupError]
    nees: Consistency
    nees_undefined: int
    nis: Consistency
    nis_attacked: Consistency
    nis_unattacked: Consistency
    error: dict[str, list[float | None]]
    attack: AttackScore | None = None
    privileged: list[str] = []
    deviation: Deviation | None = None
    bound: Bound = Bound(outside=None, guaranteed=None)


class NetworkScore(Result, frozen=True, kw_only=True):
    """Estimators that belong together: connected through neighbours, or isolated ones of one kind.

    ``rmse`` by group and step is the root mean square over the members that have not diverged by that step.
    ``disagreement_by_step`` is the RMS distance of the members' estimates from their mean; ``disagreement``
    its root mean square over steps. Both are None where fewer than two members count; the average also when
    one diverged.
    """

    members: list[str]
    rmse: dict[str, list[float | None]]
    disagreement: float | None
    disagreement_by_step: list[float | None]


class Outcome(Result, frozen=True, kw_only=True):
    """One expectation and what became of it.

    ``relation`` is ``<=``, ``>=`` or ``==``, and ``message`` shows the numbers. ``measured`` is None when it
    is undefined or unbounded (a diverged estimator); ``where`` it was measured; ``line`` is that of the
    topology.
    """

    metric: str
    nodes: list[str]
    links: list[str]
    relation: str
    bound: float
    measured: float | None
    where: str
    passed: bool
    message: str
    line: int | None


class Score(Result, frozen=True, kw_only=True):
    """The whole score of one run.

    ``steps_recorded`` counts the steps of which the record holds the truth and every estimate that is owed,
    and ``complete`` says that these are all. ``passed`` says that the run is complete and every expectation
    held. ``departed`` tells from which step on a node was silent that died though the topology did not have
    it so, and that the others outlived. ``unmatched_verdicts`` counts verdicts on packets that the channel
    never delivered. ``senders`` are the nodes with an event trigger.
    """

    name: str
    seed: int
    trial: int
    steps: int
    steps_recorded: int
    period_s: float
    options: ScoreOptions
    complete: bool
    passed: bool
    departed: dict[str, int] = {}
    nodes: list[NodeScore]
    networks: list[NetworkScore]
    links: list[LinkScore]
    traffic: Traffic
    detector: Confusion | None
    unmatched_verdicts: int
    windows: list[AttackWindow]
    lockouts: list[Lockout]
    expectations: list[Outcome]
    senders: list[SenderScore] = []

    @property
    def exchanging(self) -> frozenset[str]:
        """The estimators that a link joins to another one; each of the others is alone."""
        names = {node.name for node in self.nodes}
        joined = ({link.source, link.destination} for link in self.links)
        return frozenset(name for ends in joined if ends <= names for name in ends)

    def to_json(self) -> bytes:
        """Return the canonical JSON: equal scores give equal bytes."""
        return canonical_json(msgspec.to_builtins(self))

    @staticmethod
    def from_json(text: bytes) -> Score:
        """Read what `to_json` wrote; raises `msgspec.ValidationError` when it is something else."""
        return msgspec.json.decode(text, type=Score)
