"""What a topology file may hold, section by section; the kinds bring their own parameters."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from orchestrator.choices import Backend
from orchestrator.score.results import ScoreOptions
from orchestrator.topology.document import LARGEST_INTEGER
from orchestrator.topology.parameters import STRICT

Whole = Annotated[int, Ge(0), Le(LARGEST_INTEGER)]
LARGEST_TRIAL = 2**31 - 1
"""Results keep the numbers of trials in 32 bits."""
Number = int | float
Scope = Literal["per_link", "shared"]
"""Whether each link of a stage has a chain of its own, or all share one."""
Knowledge = Literal["topology", "model", "innovations", "keys"]
RunName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]


def _as_list(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


class Section(BaseModel):
    """A section whose keys are all known."""

    model_config = STRICT


class KindSection(BaseModel):
    """A section that names a kind: keys that are not its own are the kind's parameters."""

    model_config = ConfigDict(**{**STRICT, "extra": "allow"})

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters as they were stated."""
        return self.model_extra or {}


class PlantSection(KindSection):
    """The plant."""

    model: str = Field(description="kind of plant: a registered name, module:Class or file.py:Class")


_SEND = Field(
    default=None,
    description="event trigger that decides in which slots it sends, such as "
    "{send_on_delta: {threshold: 0.1}}; without it, in all",
)


class SensorSection(KindSection):
    """One sensor."""

    model: str = Field(description="kind of sensor: a registered name, module:Class or file.py:Class")
    send: dict[str, Any] | None = _SEND


class EstimatorSection(KindSection):
    """One estimator."""

    method: str = Field(description="kind of estimator: a registered name, module:Class or file.py:Class")
    sensors: str | list[str] | None = Field(
        default=None, description="sensors it listens to: paired (same number), all, or names and patterns"
    )
    send: dict[str, Any] | None = _SEND
    stream: RunName | None = Field(
        default=None, description="name of its random stream; those that share one draw alike"
    )


class ControllerSection(KindSection):
    """One controller: it hears an estimator and commands the plant's input."""

    law: str = Field(description="kind of controller: a registered name, module:Class or file.py:Class")
    estimator: str = Field(description="the estimator that it acts on, and that is told its inputs")


class GraphSection(KindSection):
    """Who exchanges with whom: one generator with its parameters, or edges, or a GraphML file."""

    edges: list[list[Number | str]] | None = Field(
        default=None, description="pairs of numbers or names, each with an optional weight"
    )
    graphml: str | None = Field(default=None, description="path of a GraphML file")
    directed: bool = Field(default=False, description="edges lead from the first node to the second only")
    weights: Literal["in_degree", "metropolis"] = Field(
        default="in_degree", description="h_ij: 1 / in-degree of i, or 1 / (1 + the larger degree)"
    )


class AttackSection(KindSection):
    """One attack: a kind with its parameters, what it is on, and when."""

    on: str | list[str] = Field(
        description="links: s4->e4, patterns allowed, or a list; a node stands for all links that leave it; "
        "'plant' for a signal"
    )
    steps: list[int] | list[list[int]] | None = Field(
        None,
        description="first and last step, inclusive, or several such pairs; without it the whole run",
    )
    when: dict[str, Any] | None = Field(
        default=None, description="a schedule or trigger inside these steps, such as {periodic: {every: 20}}"
    )
    name: RunName | None = Field(default=None, description="names it in the log and in random streams")
    scope: Scope | None = Field(default=None, description="whether its links share one chain")
    stream: str | None = Field(
        default=None, description="name of its random stream; {link}, {source} ... allowed"
    )


class Limit(Section):
    """What a metric is expected to be."""

    node: str | list[str] | None = None
    link: str | list[str] | None = None
    at_most: float | None = None
    at_least: float | None = None
    equals: float | None = None


class AdversarySection(Section):
    """What the adversary is granted to know; it stands in the log."""

    knows: list[Knowledge] = Field(
        default_factory=list,
        description="topology: who hears whom; model: the matrices of plant and sensors; innovations: gain "
        "and innovation covariance of the estimators' steady-state filters; keys: those of all senders",
    )


class ProcessSettings(Section):
    """How the run is carried out; nothing here changes what it computes, so none of it enters the log."""

    backend: Backend = Field(default="processes", description="one process a node, or one for all")
    window: Annotated[int, Ge(1), Le(10_000)] = Field(
        default=32, description="steps that the plant may lead the slowest node by"
    )
    stall_s: Annotated[float, Gt(0.0)] = Field(default=30.0, description="deadline of every wait (s)")
    on_crash: dict[str, Literal["stop", "silence"]] = Field(
        default_factory=dict,
        description="what becomes of the run when the process of a node dies, by pattern of names: it stops, "
        "or the channel makes empty slots in the node's place and the others go on",
    )


StageSection = str | dict[str, Any]
Stages = Annotated[list[StageSection], BeforeValidator(_as_list)]
Limits = float | Limit | list[Limit]


class TopologyFile(Section):
    """A whole topology."""

    name: RunName | None = Field(default=None, description="name of the run; the file's name when not given")
    description: str = Field(default="", description="prose; not part of the experiment")
    extends: str | None = Field(default=None, description="the topology that this one is laid over")
    seed: Whole = Field(default=0, description="seed of every random draw")
    trial: Annotated[int, Ge(0), Le(LARGEST_TRIAL)] = Field(
        default=0, description="number of the trial in a campaign"
    )
    period_s: Annotated[float, Gt(0.0)] = Field(description="sampling period (s)")
    steps: Annotated[int, Ge(1), Le(LARGEST_INTEGER)] = Field(description="number of steps")
    plant: PlantSection
    sensors: dict[str, SensorSection] = Field(
        default_factory=dict, description="by name or range s1..s20; none when estimators only exchange"
    )
    estimators: dict[str, EstimatorSection] = Field(description="by name or range e1..e20")
    controllers: dict[str, ControllerSection] = Field(
        default_factory=dict, description="by name; at most one commands the plant"
    )
    graph: GraphSection | None = None
    channel: dict[str, Stages] = Field(
        default_factory=dict,
        description="stages by link pattern, e*->e*; the last pattern that fits a link holds",
    )
    attacks: list[AttackSection] = Field(default_factory=list)
    adversary: AdversarySection = Field(default_factory=AdversarySection)
    oracles: dict[str, Annotated[list[str], BeforeValidator(_as_list)]] = Field(
        default_factory=dict,
        description="attacks that estimators are told the values of: their names, by pattern of estimators",
    )
    integrity: dict[str, Literal["none", "crc", "mac"]] = Field(
        default_factory=dict,
        description="how senders seal their packets, by pattern of names: not, by a check sum, or by a key",
    )
    expect: dict[str, Limits] = Field(default_factory=dict, description="figures that make the file a test")
    score: ScoreOptions = Field(default_factory=ScoreOptions)
    process: ProcessSettings = Field(default_factory=ProcessSettings)
