"""Kinds: how they are named, and how their constructors become typed parameters."""

from __future__ import annotations

from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest
from pydantic import ValidationError

from bus.kinds import KindError
from nodes.gaussian import Gaussian
from orchestrator import registry
from orchestrator.registry import ROLES, UnknownKindError, describe_kinds, find_kind, registered
from orchestrator.topology.parameters import fill, parameter_names, parameters_model, plain, values

OWN = """\
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt

from nodes.gaussian import Gaussian


class Rich:
    def __init__(
        self,
        placement,
        *,
        gains: list[list[float]],
        law: Gaussian,
        mode: Literal["fast", "slow"] = "fast",
        limit: Annotated[float, Gt(0)] | None = 3.0,
        copy: bool = False,
    ) -> None:
        pass


class Heir(Rich):
    pass


class Bare:
    pass


@dataclass(frozen=True)
class Law:
    scale: float


class Untyped:
    def __init__(self, placement, *, gain) -> None: ...


class Greedy:
    def __init__(self, placement, **rest: float) -> None: ...


class Reserved:
    def __init__(self, placement, *, stream: str) -> None: ...


class Foreign:
    def __init__(self, placement, *, gain: np.ndarray) -> None: ...


class OwnType:
    def __init__(self, placement, *, law: Law) -> None: ...


class Unreadable:
    def __init__(self, placement, *, gain: "Nowhere") -> None: ...
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "own.py").write_text(OWN)
    return tmp_path


def test_every_registered_kind_can_be_described_and_parametrised() -> None:
    assert {kind["role"] for kind in describe_kinds()} == set(ROLES)
    for role in ROLES:
        for name in registered(role):
            parameters_model(find_kind(role, name, Path.cwd()), role)
    assert not [kind for kind in describe_kinds() if "cannot be loaded" in kind["summary"]]


def test_the_first_parameter_belongs_to_the_role(folder: Path) -> None:
    model = parameters_model(find_kind("impairments", "./own.py:Rich", folder), "impairments")
    assert parameter_names(model) == ("gains", "law", "mode", "limit", "copy")


def test_parameters_are_typed_for_the_class_and_plain_for_the_file(folder: Path) -> None:
    model = parameters_model(find_kind("impairments", "./own.py:Heir", folder), "impairments")
    filled = fill(model, {"gains": [[1, 2]], "law": {"std": 1}, "limit": None, "copy": None})
    assert values(filled) == {
        "gains": [[1.0, 2.0]],
        "law": Gaussian(std=1.0),
        "mode": "fast",
        "limit": None,
        "copy": False,
    }
    assert plain(filled) == {
        "gains": [[1.0, 2.0]],
        "law": {"std": 1.0, "covariance": None, "mean": None},
        "mode": "fast",
        "limit": None,
        "copy": False,
    }
    assert values(fill(model, plain(filled))) == values(filled)


@pytest.mark.parametrize(
    "wrong",
    [
        {"mode": "Fast"},
        {"limit": 0},
        {"limit": "3"},
        {"copy": 1},
        {"gains": [1, 2]},
        {"law": {"std": 1, "scale": 2}},
        {"law": None},
        {"other": 1},
    ],
)
def test_nothing_is_guessed(folder: Path, wrong: dict[str, object]) -> None:
    model = parameters_model(find_kind("impairments", "./own.py:Rich", folder), "impairments")
    with pytest.raises(ValidationError):
        fill(model, {"gains": [[1]], "law": {"std": 1}, **wrong})


def test_a_class_without_constructor_has_no_parameters(folder: Path) -> None:
    assert parameter_names(parameters_model(find_kind("sensors", "./own.py:Bare", folder), "sensors")) == ()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Untyped", "parameter 'gain' of .* has no type"),
        ("Greedy", "cannot be given by name"),
        ("Reserved", "a name that a topology uses itself"),
        ("Foreign", "cannot state the parameters"),
        ("OwnType", "other processes cannot unpickle"),
        ("Unreadable", "annotations of .* cannot be read"),
    ],
)
def test_what_a_topology_cannot_state_is_refused_with_the_cure(folder: Path, name: str, words: str) -> None:
    found = find_kind("impairments", f"./own.py:{name}", folder)
    with pytest.raises(KindError, match=words):
        parameters_model(found, "impairments")


def test_a_kind_may_be_a_class_of_a_module() -> None:
    found = find_kind("estimators", "nodes.estimators.kalman:Kalman", Path.cwd())
    assert (found.name, found.short_name) == ("nodes.estimators.kalman:Kalman", "Kalman")


def test_an_unknown_kind_names_those_that_are_known() -> None:
    with pytest.raises(UnknownKindError) as caught:
        find_kind("sensors", "lidar", Path.cwd())
    assert caught.value.known == ("linear", "student_t", "tank_outflow", "innovation", "ceiling_camera")


def test_an_entry_point_registers_a_kind_and_hides_no_built_in_one(monkeypatch: pytest.MonkeyPatch) -> None:
    own = {"mine": "nodes.estimators.kalman:Kalman", "kalman": "nowhere:Nothing"}
    points = EntryPoints(EntryPoint(name, value, "gauntlet.estimators") for name, value in own.items())
    monkeypatch.setattr(registry, "_entry_points", lambda: points)
    registry.registered.cache_clear()
    try:
        assert find_kind("estimators", "mine", Path.cwd()).reference == "nodes.estimators.kalman:Kalman"
        assert registered("estimators")["kalman"] == "nodes.estimators.kalman:Kalman"
    finally:
        registry.registered.cache_clear()
