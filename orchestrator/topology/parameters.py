"""Typed parameters of a kind: a model made from its constructor, filled from a topology, dumped as JSON."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
import types
import typing
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, create_model
from pydantic.errors import PydanticSchemaGenerationError, PydanticUserError

from bus.kinds import KindError
from orchestrator.registry import FoundKind, Role

RESERVED_PARAMETERS: Mapping[Role, frozenset[str]] = {
    "plants": frozenset({"model"}),
    "sensors": frozenset({"model", "send"}),
    "estimators": frozenset({"method", "sensors", "send"}),
    "controllers": frozenset({"law", "estimator"}),
    "graphs": frozenset({"directed", "weights"}),
    "impairments": frozenset({"name", "scope", "stream"}),
    "attacks": frozenset({"name", "on", "scope", "steps", "stream", "when"}),
    "signals": frozenset({"name", "on", "scope", "steps", "stream", "when"}),
    "faults": frozenset({"name", "on", "scope", "steps", "stream", "when"}),
    "schedules": frozenset(),
    "triggers": frozenset(),
}

STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, protected_namespaces=())


class Parameters(BaseModel):
    """Base of the models that are made from constructors."""

    model_config = STRICT


@functools.cache
def parameters_model(kind: FoundKind, role: Role) -> type[Parameters]:
    """Return the model of a kind's parameters.

    These are the constructor's parameters after the first, which the role fills (all of them for a graph).
    Raises `KindError` when a topology cannot state one of them.
    """
    constructor = inspect.getattr_static(kind.type, "__init__")
    given = 1 if role in ("graphs", "faults") else 2
    stated = list(inspect.signature(constructor).parameters.values())[given:]
    if constructor is object.__init__:
        stated = []
    try:
        hints = typing.get_type_hints(constructor, include_extras=True) if stated else {}
    except NameError as error:
        raise KindError(f"the annotations of {kind.name} cannot be read: {error}") from error
    fields: dict[str, Any] = {}
    for parameter in stated:
        _check_parameter(kind, role, parameter, hints.get(parameter.name))
        default = ... if parameter.default is parameter.empty else parameter.default
        field = Field(default, alias=parameter.name)
        fields[f"p_{parameter.name}"] = (hints[parameter.name], field)
    try:
        return create_model(
            kind.type.__name__, __base__=Parameters, __doc__=inspect.getdoc(kind.type), **fields
        )
    except (PydanticSchemaGenerationError, PydanticUserError) as error:
        why = str(error).splitlines()[0]
        raise KindError(f"a topology cannot state the parameters of {kind.name}: {why}") from error


def _check_parameter(kind: FoundKind, role: Role, parameter: inspect.Parameter, hint: Any) -> None:
    name = parameter.name
    if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD, parameter.POSITIONAL_ONLY):
        raise KindError(f"parameter '{name}' of {kind.name} cannot be given by name; make it keyword-only")
    if name in RESERVED_PARAMETERS[role]:
        raise KindError(
            f"parameter '{name}' of {kind.name} has a name that a topology uses itself; rename it"
        )
    if hint is None:
        raise KindError(f"parameter '{name}' of {kind.name} has no type; annotate it, for example with float")
    for part in _parts(hint):
        if dataclasses.is_dataclass(part) and part.__module__.startswith("gauntlet_user_"):
            raise KindError(
                f"parameter '{name}' of {kind.name} has a type of a file of the user's, which other "
                "processes cannot unpickle; use plain types, or put it into an importable module"
            )


def _parts(hint: Any) -> typing.Iterator[Any]:
    """Yield a type and all the types inside it."""
    yield hint
    for part in typing.get_args(hint):
        yield from _parts(part)


def may_be_null(hint: Any) -> bool:
    """Return whether a type admits None."""
    if typing.get_origin(hint) is typing.Annotated:
        return may_be_null(typing.get_args(hint)[0])
    if isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union:
        return any(may_be_null(part) for part in typing.get_args(hint))
    return hint is None or hint is type(None) or hint is Any


def fill(model: type[Parameters], stated: Mapping[str, Any]) -> Parameters:
    """Return the parameters that a topology states; raises `pydantic.ValidationError`.

    A null is left out unless the parameter may be null. Values are read as JSON: a whole number may stand for
    a float, and nothing else is converted.
    """
    nullable = {field.alias for field in model.model_fields.values() if may_be_null(field.annotation)}
    kept = {name: value for name, value in stated.items() if value is not None or name in nullable}
    return model.model_validate_json(json.dumps(kept))


def values(parameters: Parameters) -> dict[str, Any]:
    """Return the parameters as the constructor takes them."""
    return {
        str(field.alias): getattr(parameters, name) for name, field in type(parameters).model_fields.items()
    }


def plain(parameters: Parameters) -> dict[str, Any]:
    """Return the parameters as plain JSON data, defaults included."""
    dumped: dict[str, Any] = parameters.model_dump(mode="json", by_alias=True)
    return dumped


def parameter_names(model: type[Parameters]) -> tuple[str, ...]:
    """Return the names of a kind's parameters."""
    return tuple(str(field.alias) for field in model.model_fields.values())
