"""The JSON Schema of topology files, for editors: the sections, and in them the parameters of every kind."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bus.kinds import KindError
from orchestrator.registry import BUILT_IN, Role, find_kind, registered
from orchestrator.score.catalogue import METRICS
from orchestrator.topology.parameters import parameters_model
from orchestrator.topology.schema import AttackSection, ControllerSection, EstimatorSection, TopologyFile
from orchestrator.topology.stages import STAGE_OPTIONS

_USERS_OWN = ":"
_Schema = dict[str, Any]
_BOUNDED: _Schema = {"anyOf": [{"required": [bound]} for bound in ("at_most", "at_least", "equals")]}
_NO_LIMIT: _Schema = {"not": {"type": "object"}}


def schema(*, installed: bool = True) -> _Schema:
    """Return the JSON Schema; without ``installed``, of the built-in kinds only."""
    definitions: _Schema = {}
    whole = TopologyFile.model_json_schema(ref_template="#/$defs/{model}")
    definitions.update(whole.pop("$defs"))
    makers = _Kinds(definitions, installed)
    definitions["PlantSection"] = makers.node("plants", "model", {})
    definitions["Send"] = makers.members("triggers", {"type": "object", "properties": {}}, {})
    sending = {"send": {"anyOf": [{"$ref": "#/$defs/Send"}, {"type": "null"}]}}
    definitions["SensorSection"] = makers.node("sensors", "model", sending)
    known = EstimatorSection.model_json_schema()["properties"]
    own = {key: known[key] for key in ("sensors", "stream")}
    definitions["EstimatorSection"] = makers.node("estimators", "method", {**own, **sending})
    acting = ControllerSection.model_json_schema()["properties"]["estimator"]
    definitions["ControllerSection"] = makers.node("controllers", "law", {"estimator": acting})
    definitions["GraphSection"] = makers.members("graphs", definitions["GraphSection"], {})
    attack = makers.members(
        "attacks", definitions["AttackSection"], {}, also=("impairments", "signals", "faults")
    )
    own = AttackSection.model_json_schema()["properties"]
    definitions["AttackSection"] = {**attack, "required": ["on"], **_one_kind(attack, own)}
    options = {key: AttackSection.model_json_schema()["properties"][key] for key in STAGE_OPTIONS}
    on_link = makers.members("impairments", {"type": "object", "properties": {}}, options)
    definitions["Stage"] = {**on_link, **_one_kind(on_link, ())}
    stage = {"anyOf": [{"type": "string"}, {"$ref": "#/$defs/Stage"}]}
    stages = {"anyOf": [*stage["anyOf"], {"type": "array", "items": stage}, {"type": "null"}]}
    whole["properties"]["channel"]["additionalProperties"] = stages
    whole["properties"]["expect"] = _expect(whole["properties"]["expect"], definitions)
    for section in ("sensors", "estimators"):
        members = whole["properties"][section]["additionalProperties"]
        whole["properties"][section]["additionalProperties"] = {"anyOf": [members, {"type": "null"}]}
    whole.pop("required", None)  # a base, or a file that extends one, may leave anything out
    whole["title"] = "Gauntlet topology"
    alone = {"properties": {"expect": {"additionalProperties": {"anyOf": [_NO_LIMIT, _BOUNDED]}}}}
    whole |= {"if": {"required": ["extends"]}, "else": alone}  # a base may have the bound
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **whole, "$defs": definitions}


def _one_kind(section: _Schema, own: Iterable[str]) -> _Schema:
    """Return the rule that a section, beside its own keys, has exactly one of its members."""
    users_own = {"not": {"propertyNames": {"not": {"pattern": _USERS_OWN}}}}
    kinds = [name for name in section["properties"] if name not in own]
    return {"oneOf": [*({"required": [name]} for name in kinds), users_own]}


def _expect(section: _Schema, definitions: _Schema) -> _Schema:
    """Return the schema of expectations: of metrics that there are, and in a list each with a bound."""
    number, limit, several = section["additionalProperties"]["anyOf"]
    bounded = {**several, "items": {"allOf": [several["items"], _BOUNDED]}}
    definitions["Limits"] = {"anyOf": [number, limit, bounded, {"type": "null"}]}
    limits = {"allOf": [{"$ref": "#/$defs/Limits"}]}
    families = [name.removesuffix(".*") for name in METRICS if name.endswith(".*")]
    properties = {
        name: {"description": metric.meaning, **limits}
        for name, metric in METRICS.items()
        if not name.endswith(".*")
    }
    of_groups = {rf"^({'|'.join(families)})\.[^*]+$": limits}
    kept = {key: value for key, value in section.items() if key != "additionalProperties"}
    return {**kept, "properties": properties, "patternProperties": of_groups, "additionalProperties": False}


def schema_text() -> str:
    """Return the text of docs/topology.schema.json: the same on every machine."""
    return json.dumps(_plain_numbers(schema(installed=False)), indent=1, ensure_ascii=False) + "\n"


def _plain_numbers(value: Any) -> Any:
    """Write 0.0 as 0: equal bounds are one object to `typing`, whichever spelling was imported first."""
    if isinstance(value, dict):
        return {key: _plain_numbers(member) for key, member in value.items()}
    if isinstance(value, list):
        return [_plain_numbers(member) for member in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


class _Kinds:
    """Makes schemas of sections that name kinds. Files may be partial, so nothing is required."""

    def __init__(self, definitions: _Schema, installed: bool) -> None:
        self._definitions = definitions
        self._installed = installed

    def node(self, role: Role, key: str, own: Mapping[str, Any]) -> _Schema:
        """Return the schema of a node: ``key`` names its kind, and decides which parameters it has."""
        names = self._names(role)
        choice = {"anyOf": [{"enum": names}, {"type": "string", "pattern": _USERS_OWN}]}
        rules = []
        for name in names:
            parameters = self._parameters(role, name)
            if parameters is not None:
                allowed = {key: True, **own, **parameters["properties"]}
                then = {"properties": allowed, "additionalProperties": False}
                rules.append({"if": {"properties": {key: {"const": name}}, "required": [key]}, "then": then})
        return {"type": "object", "properties": {key: choice, **own}, "allOf": rules}

    def members(
        self, role: Role, section: _Schema, options: Mapping[str, Any], also: Iterable[Role] = ()
    ) -> _Schema:
        """Return the schema of a mapping whose kind is a member, beside the section's own keys."""
        properties = dict(section.get("properties", {}))
        for each in (role, *also):
            for name in self._names(each):
                parameters = self._parameters(each, name)
                if parameters is not None:
                    allowed = {**parameters["properties"], **options}
                    body = {**parameters, "properties": allowed}
                    body.pop("required", None)
                    properties[name] = {"anyOf": [body, {"type": "null"}]}
        users_own = {_USERS_OWN: {"type": ["object", "null"]}}
        kept = {key: value for key, value in section.items() if key not in ("properties", "required")}
        return {
            **kept,
            "properties": properties,
            "patternProperties": users_own,
            "additionalProperties": False,
        }

    def _names(self, role: Role) -> list[str]:
        return list(registered(role) if self._installed else BUILT_IN[role])

    def _parameters(self, role: Role, name: str) -> _Schema | None:
        """Return the schema of a kind's parameters, None when the kind cannot be loaded here."""
        try:
            model = parameters_model(find_kind(role, name, Path.cwd()), role)
        except KindError:
            return None
        body = model.model_json_schema(by_alias=True, ref_template="#/$defs/{model}")
        self._definitions.update(body.pop("$defs", {}))
        body.pop("title", None)
        return {**body, "properties": body.get("properties", {})}


if __name__ == "__main__":
    sys.stdout.write(schema_text())
