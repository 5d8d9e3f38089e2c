"""Builds every node and stage once, to find what only their classes know."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from bus.random_streams import random_stream
from channel.contract import Placement
from nodes.build import asks_for_sensors
from nodes.contract import ControlledPlant, ControllerSetting, Estimator, Plant, Sensor, Setting, Trigger
from nodes.signal_attack import Signal
from nodes.triggers.contract import TriggerSetting
from orchestrator.topology.draft import CheckedKind, Draft
from orchestrator.topology.placement import PlacedStage
from orchestrator.topology.problems import PathKeys
from orchestrator.topology.stages import DeclaredStage

T = TypeVar("T")


def tried(draft: Draft, path: PathKeys, what: str, build: Callable[[], T]) -> T | None:
    """Return what ``build`` makes; its refusal is noted at the path."""
    try:
        return build()
    except ValueError as error:
        draft.complain(path, f"{what}: {error}")
    except Exception as error:
        draft.complain(path, f"{what} cannot be constructed: {type(error).__name__}: {error}")
    return None


def build_plant(draft: Draft, checked: CheckedKind) -> Plant | None:
    """Return the plant, None when its class refuses."""
    period_s = draft.sections["period_s"]
    plant: Plant | None = tried(
        draft,
        ("plant",),
        f"plant {checked.found.short_name}",
        lambda: checked.found.type(period_s, **checked.parameters),
    )
    if plant is None:
        return None
    missing = [
        name for name in ("state_groups", "initial_mean", "initial_covariance") if not hasattr(plant, name)
    ]
    if missing:
        draft.complain(
            ("plant", "model"), f"a plant needs the attribute '{missing[0]}'", "see nodes/contract.py"
        )
        return None
    return plant


def build_sensors(draft: Draft, kinds: Mapping[str, CheckedKind], plant: Plant) -> dict[str, Sensor]:
    """Return the sensors whose classes accept."""
    built: dict[str, Sensor] = {}
    for name, checked in kinds.items():
        sensor: Sensor | None = _built_sensor(draft, name, checked, plant)
        if sensor is not None:
            built[name] = sensor
    return built


def _built_sensor(draft: Draft, name: str, checked: CheckedKind, plant: Plant) -> Any:
    what = f"sensor {checked.found.short_name}"
    return tried(draft, ("sensors", name), what, lambda: checked.found.type(plant, **checked.parameters))


class EstimatorBuilder:
    """Builds estimators with the neighbours that are asked for; ``told`` are those with an oracle."""

    def __init__(
        self,
        draft: Draft,
        kinds: Mapping[str, CheckedKind],
        plant: Plant,
        sensors: Mapping[str, Sensor],
        listens: Mapping[str, Sequence[str]],
        triggers: Mapping[str, CheckedKind],
        told: Collection[str] = (),
    ) -> None:
        self._triggers = triggers
        self._told = told
        self._draft = draft
        self._kinds = kinds
        self._plant = plant
        self._sensors = sensors
        self._listens = listens

    def build(self, name: str, neighbours: Mapping[str, float]) -> Estimator | None:
        """Return an estimator, None when its class refuses."""
        checked = self._kinds[name]
        sections = self._draft.sections
        stream = sections["estimators"][name].stream or name
        asks = asks_for_sensors(checked.found.type)
        setting = Setting(
            name=name,
            plant=self._plant,
            sensors=self._heard_by(name),
            neighbours=dict(sorted(neighbours.items())),
            rng=random_stream(sections["seed"], sections["trial"], stream, "estimator"),
            told_attacks=name in self._told,
            neighbour_sensors={other: self._heard_by(other) for other in neighbours} if asks else {},
            trigger=self._trigger(name) if getattr(checked.found.type, "takes_trigger", False) else None,
            sensor_triggers={
                sensor: trigger for sensor in self._listens[name] if (trigger := self._trigger(sensor))
            },
        )
        what = f"estimator {checked.found.short_name}"
        path = ("estimators", name)
        return tried(self._draft, path, what, lambda: checked.found.type(setting, **checked.parameters))

    def _trigger(self, sender: str) -> Trigger | None:
        """Return a node's event trigger, which was built before without complaint; None when it has none."""
        checked = self._triggers.get(sender)
        if checked is None:
            return None
        setting = TriggerSetting(sender, self._plant, self._sensors.get(sender), np.random.default_rng(0))
        trigger: Trigger = checked.found.type(setting, **checked.parameters)
        return trigger

    def _heard_by(self, name: str) -> dict[str, Sensor]:
        """Return the models of the sensors that an estimator listens to."""
        return {sensor: self._sensors[sensor] for sensor in self._listens[name]}

    def rounds(self, name: str, neighbours: Mapping[str, float]) -> int:
        """Return the exchange rounds of an estimator with these neighbours; 0 when it cannot tell (noted)."""
        built = self.build(name, neighbours)
        if built is None:
            return 0
        rounds = getattr(built, "rounds", None)
        if not isinstance(rounds, int) or isinstance(rounds, bool) or rounds < 0:
            path = ("estimators", name, "method")
            self._draft.complain(
                path, "an estimator needs the attribute 'rounds', at least 0", "see nodes/contract.py"
            )
            return 0
        return rounds


def build_controllers(
    draft: Draft, kinds: Mapping[str, CheckedKind], estimators: Mapping[str, CheckedKind], plant: Plant
) -> None:
    """Note what the classes of the controllers refuse, and a plant that takes no input.

    An estimator that is not to be told of the input is warned of: its prediction leaves the input out.
    """
    if kinds and not (isinstance(plant, ControlledPlant) and plant.B.shape[1]):
        draft.complain(("plant",), "the plant has no input for the controllers", "give it 'B'")
        return
    for name, checked in kinds.items():
        rng = random_stream(draft.sections["seed"], draft.sections["trial"], name, "controller")
        setting = ControllerSetting(name, plant, rng)
        build = functools.partial(checked.found.type, setting, **checked.parameters)
        tried(draft, ("controllers", name), f"controller {checked.found.short_name}", build)
        heard = draft.sections["controllers"][name].estimator
        if heard in estimators and not hasattr(estimators[heard].found.type, "control"):
            message = f"{heard} does not take the input of {name} into account"
            cure = "use a method that does, such as kalman, or give yours 'control(step, packets)'"
            draft.warn(("estimators", heard, "method"), message, cure)


def check_signals(draft: Draft, attacks: Sequence[DeclaredStage], plant: Plant) -> None:
    """Note what the classes of signal attacks refuse, and signals of another size than the plant takes."""
    size: int | None = getattr(plant, "signal_size", None)
    enters = int(np.shape(getattr(plant, "G", np.zeros((0, 0))))[1]) if size is None else size
    for stage in attacks:
        if stage.role != "signal":
            continue
        rng = random_stream(0, 0, "signal", stage.purpose)
        build = functools.partial(stage.checked.found.type, rng, **stage.checked.parameters)
        signal: Signal | None = tried(draft, stage.path, stage.checked.found.short_name, build)
        if signal is not None and signal.size != enters:
            cure = (
                "give the plant 'G' with a column for each component of the signal"
                if size is None
                else "give the signal as many, or the plant another signal"
            )
            message = f"a signal of {signal.size} components for a plant that takes {enters}"
            draft.complain(stage.path, message, cure)


def build_stages(draft: Draft, placed: Sequence[PlacedStage]) -> None:
    """Note what the classes of the stages refuse."""
    seed, trial = draft.sections["seed"], draft.sections["trial"]
    for stage in placed:
        plan, checked = stage.plan, stage.declared.checked
        generators = {
            name: random_stream(seed, trial, name, plan.purpose) for name in set(plan.streams.values())
        }
        placement = Placement(
            plan.label,
            plan.streams,
            generators,
            plan.timing.first,
            plan.timing.last,
            knowledge=plan.knowledge,
        )
        build = functools.partial(checked.found.type, placement, **checked.parameters)
        tried(draft, stage.declared.path, checked.found.short_name, build)
