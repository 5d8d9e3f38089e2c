"""Every kind a topology can name, by role: built in, from entry points, or a user's own class.

A kind is named in one of three ways: by a registered name (``kalman``), as ``module:Class``, or as
``path/to/file.py:Class``. A package registers kinds with entry points of the group of their role, for example
``[project.entry-points."gauntlet.estimators"]`` with ``my_filter = "my_package.filters:MyFilter"``.
"""

from __future__ import annotations

import functools
import inspect
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args

from bus.kinds import KindError, content_hash, is_file_reference, load_class

Role = Literal[
    "plants",
    "sensors",
    "estimators",
    "controllers",
    "graphs",
    "impairments",
    "attacks",
    "signals",
    "faults",
    "schedules",
    "triggers",
]
ROLES: tuple[Role, ...] = get_args(Role)

_GENERATORS = "orchestrator.topology.graph_generators"
_ESTIMATORS = "nodes.estimators"
_EVENT_TRIGGERED = f"{_ESTIMATORS}.event_triggered_extended_kalman"
_TRIGGERS = "nodes.triggers"
_DATA_ASSOCIATION = "nodes.estimators.probabilistic_data_association"

BUILT_IN = MappingProxyType[Role, MappingProxyType[str, str]](
    {
        "plants": MappingProxyType(
            {
                "linear": "nodes.plants.linear:Linear",
                "constant_acceleration": "nodes.plants.constant_acceleration:ConstantAcceleration",
                "quadruple_tank": "nodes.plants.quadruple_tank:QuadrupleTank",
                "linear_benchmark": "nodes.plants.linear_benchmark:LinearBenchmark",
                "swing_network": "nodes.plants.swing_network:SwingNetwork",
                "ieee14": "nodes.plants.ieee14:Ieee14",
                "sine_swing_network": "nodes.plants.sine_swing:SineSwingNetwork",
                "sine_ieee14": "nodes.plants.sine_swing:SineIeee14",
                "planar_robot": "nodes.plants.planar_robot:PlanarRobot",
            }
        ),
        "sensors": MappingProxyType(
            {
                "linear": "nodes.sensors.linear:Linear",
                "student_t": "nodes.sensors.student_t:StudentT",
                "tank_outflow": "nodes.sensors.tank_outflow:TankOutflow",
                "innovation": "nodes.sensors.innovation:Innovation",
                "ceiling_camera": "nodes.sensors.ceiling_camera:CeilingCamera",
            }
        ),
        "estimators": MappingProxyType(
            {
                "kalman": "nodes.estimators.kalman:Kalman",
                "kalman_centralized": "nodes.estimators.kalman_centralized:KalmanCentralized",
                "extended_kalman": "nodes.estimators.extended_kalman:ExtendedKalman",
                "unscented_kalman": "nodes.estimators.unscented_kalman:UnscentedKalman",
                "distributed_particle": "nodes.estimators.distributed_particle:DistributedParticle",
                "distributed_particle_fdi": (
                    "nodes.estimators.distributed_particle_fdi:DistributedParticleFdi"
                ),
                "particle": "nodes.estimators.particle:Particle",
                "particle_fdi": "nodes.estimators.particle_fdi:ParticleFdi",
                "particle_unweighted": "nodes.estimators.particle_unweighted:ParticleUnweighted",
                "innovation_kalman": "nodes.estimators.innovation_kalman:InnovationKalman",
                "secure_distributed": "nodes.estimators.secure_distributed:SecureDistributed",
                "fixed_gain_consensus": "nodes.estimators.fixed_gain_consensus:FixedGainConsensus",
                "kalman_consensus": f"{_ESTIMATORS}.kalman_consensus:KalmanConsensus",
                "information_consensus": f"{_ESTIMATORS}.information_consensus:InformationConsensus",
                "diffusion_kalman": f"{_ESTIMATORS}.diffusion_kalman:DiffusionKalman",
                "covariance_intersection": f"{_ESTIMATORS}.covariance_intersection:CovarianceIntersection",
                "hybrid_bernoulli": "nodes.estimators.hybrid_bernoulli:HybridBernoulli",
                "event_triggered_kalman": f"{_ESTIMATORS}.event_triggered_kalman:EventTriggeredKalman",
                "jise": "nodes.estimators.jise:Jise",
                "imm": "nodes.estimators.imm:Imm",
                "probabilistic_data_association": f"{_DATA_ASSOCIATION}:ProbabilisticDataAssociation",
                "event_triggered_extended_kalman": f"{_EVENT_TRIGGERED}:EventTriggeredExtendedKalman",
                "dead_reckoning": "nodes.estimators.dead_reckoning:DeadReckoning",
                "external": "nodes.estimators.external:External",
            }
        ),
        "graphs": MappingProxyType(
            {
                "ring": f"{_GENERATORS}:Ring",
                "grid": f"{_GENERATORS}:Grid",
                "complete": f"{_GENERATORS}:Complete",
                "random_geometric": f"{_GENERATORS}:RandomGeometric",
            }
        ),
        "impairments": MappingProxyType(
            {
                "perfect": "channel.impairments.perfect:Perfect",
                "bernoulli": "channel.impairments.bernoulli:Bernoulli",
                "gilbert_elliott": "channel.impairments.gilbert_elliott:GilbertElliott",
                "outage": "channel.impairments.outage:Outage",
                "jammer": "channel.impairments.jammer:Jammer",
                "delay": "channel.impairments.delay:Delay",
                "reorder": "channel.impairments.reorder:Reorder",
                "duplicate": "channel.impairments.duplicate:Duplicate",
                "corrupt": "channel.impairments.corrupt:Corrupt",
                "rate": "channel.impairments.rate:Rate",
                "quantise": "channel.impairments.quantise:Quantise",
                "saturate": "channel.impairments.saturate:Saturate",
            }
        ),
        "attacks": MappingProxyType(
            {
                "bias": "channel.attacks.bias:Bias",
                "drift": "channel.attacks.drift:Drift",
                "converging_bias": "channel.attacks.converging_bias:ConvergingBias",
                "scaling": "channel.attacks.scaling:Scaling",
                "noise": "channel.attacks.noise:Noise",
                "constant": "channel.attacks.constant:Constant",
                "hold": "channel.attacks.hold:Hold",
                "stale": "channel.attacks.stale:Stale",
                "series": "channel.attacks.series:Series",
                "flip": "channel.attacks.flip:Flip",
                "substitution": "channel.attacks.substitution:Substitution",
                "injection": "channel.attacks.injection:Injection",
                "replay": "channel.attacks.replay:Replay",
                "sybil": "channel.attacks.sybil:Sybil",
                "babbling": "channel.attacks.babbling:Babbling",
                "byzantine": "channel.attacks.byzantine:Byzantine",
                "zero_dynamics": "channel.attacks.zero_dynamics:ZeroDynamics",
                "covert": "channel.attacks.covert:Covert",
                "optimal_linear": "channel.attacks.optimal_linear:OptimalLinear",
                "worst_case_bias": "channel.attacks.worst_case_bias:WorstCaseBias",
            }
        ),
        "controllers": MappingProxyType(
            {
                "state_feedback": "nodes.controllers.state_feedback:StateFeedback",
                "lqr": "nodes.controllers.lqr:Lqr",
            }
        ),
        "signals": MappingProxyType({"signal": "nodes.signal_attack:Signal"}),
        "faults": MappingProxyType({"crash": "nodes.faults:Crash", "hang": "nodes.faults:Hang"}),
        "schedules": MappingProxyType(
            {
                "periodic": "bus.schedules:Periodic",
                "bernoulli": "bus.schedules:BernoulliSchedule",
                "markov": "bus.schedules:MarkovSchedule",
                "state_crosses": "bus.schedules:StateCrosses",
                "alarm": "bus.schedules:Alarm",
            }
        ),
        "triggers": MappingProxyType(
            {
                "periodic": "nodes.triggers.periodic:Periodic",
                "send_on_delta": "nodes.triggers.send_on_delta:SendOnDelta",
                "relative": "nodes.triggers.relative:Relative",
                "deterministic_innovation": f"{_TRIGGERS}.deterministic_innovation:DeterministicInnovation",
                "stochastic_innovation": f"{_TRIGGERS}.stochastic_innovation:StochasticInnovation",
            }
        ),
    }
)


def own_modules() -> list[str]:
    """Return the modules of all built-in kinds that a process of a run may be told to run."""
    references = (
        reference for role, kinds in BUILT_IN.items() if role != "graphs" for reference in kinds.values()
    )
    return sorted({reference.rpartition(":")[0] for reference in references})


class UnknownKindError(KindError):
    """No role has a kind of this name; ``known`` lists what there is."""

    def __init__(self, message: str, known: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.known = known


@dataclass(frozen=True)
class FoundKind:
    """A kind that was found: the class, how a topology names it, and how a plan does.

    ``name`` is what a resolved topology holds: the registered name, ``module:Class``, or the absolute path of
    a file. ``short_name`` is what random streams are addressed by: it does not depend on where a file lies.
    """

    name: str
    short_name: str
    reference: str
    type: type


@functools.cache
def registered(role: Role) -> MappingProxyType[str, str]:
    """Return the registered kinds of a role: built-in names first, then those of entry points."""
    kinds = dict(BUILT_IN[role])
    for point in sorted(_entry_points().select(group=f"gauntlet.{role}"), key=lambda point: point.name):
        kinds.setdefault(point.name, point.value)
    return MappingProxyType(kinds)


@functools.cache
def _entry_points() -> Any:
    """Return the entry points of all roles at once: to find some, a file of every package is read."""
    from importlib.metadata import entry_points

    return entry_points()


def find_kind(role: Role, name: str, directory: Path) -> FoundKind:
    """Return the kind of a name; paths of files are relative to ``directory``.

    Raises
    ------
    UnknownKindError
        When nothing of that name is registered.
    KindError
        When it is, but the class cannot be loaded.
    """
    if ":" not in name:
        reference = BUILT_IN[role].get(name) or registered(role).get(name)
        if reference is None:
            raise UnknownKindError(f"there is no {role[:-1]} kind '{name}'", tuple(registered(role)))
        return FoundKind(name, name, reference, load_class(reference))
    location, _, class_name = name.rpartition(":")
    if is_file_reference(name):
        name = f"{(directory / location).resolve()}:{class_name}"
    return FoundKind(name, class_name, name, load_class(name))


def describe_kinds() -> list[dict[str, str]]:
    """Return every registered kind: its ``role``, ``name``, ``reference`` and one-line ``summary``."""
    return [
        {"role": role, "name": name, "reference": reference, "summary": _summary(reference)}
        for role in ROLES
        for name, reference in registered(role).items()
    ]


def _summary(reference: str) -> str:
    try:
        return (inspect.getdoc(load_class(reference)) or "").partition("\n")[0]
    except KindError as error:
        return f"cannot be loaded: {error}"


def portable_name(name: str) -> str:
    """Return the name by which a log knows a kind: a user's file by the hash of its content."""
    location, _, class_name = name.rpartition(":")
    if not is_file_reference(name):
        return name
    return f"sha256-{content_hash(Path(location))}:{class_name}"
