"""A topology that is being checked: its entries, the sections in order so far, and the problems."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from bus.kinds import KindError
from bus.plan import Kind
from orchestrator.registry import FoundKind, Role, UnknownKindError, find_kind
from orchestrator.topology.complaints import complain, is_missing_key
from orchestrator.topology.document import Entry
from orchestrator.topology.inheritance import KIND_KEYS
from orchestrator.topology.parameters import Parameters, fill, parameters_model, plain, values
from orchestrator.topology.problems import PathKeys, Problems, did_you_mean
from orchestrator.topology.schema import TopologyFile

_OWN_KEYS: Mapping[str, frozenset[str]] = {
    "plant": frozenset({"model"}),
    "sensors": frozenset({"model", "send"}),
    "estimators": frozenset({"method", "sensors", "send"}),
    "controllers": frozenset({"law", "estimator"}),
}
_ROLES: Mapping[str, Role] = {
    "plant": "plants",
    "sensors": "sensors",
    "estimators": "estimators",
    "controllers": "controllers",
}


@dataclass(frozen=True)
class CheckedKind:
    """A kind whose parameters are in order. ``plain`` holds them as JSON data, defaults included."""

    found: FoundKind
    parameters: Mapping[str, Any]
    plain: Mapping[str, Any]

    @property
    def kind(self) -> Kind:
        """The kind as a plan holds it."""
        return Kind(self.found.reference, self.parameters)


@dataclass
class Draft:
    """See the module. ``sections`` holds, by top-level key, what the schema accepts.

    An ``incomplete`` topology is a base: keys may be missing. The nodes' names are ``sound`` when nothing was
    wrong with the file as such; otherwise what refers to them is not worth checking.
    """

    root: Entry
    problems: Problems
    incomplete: bool = False
    sound: bool = True
    warnings: Problems = field(default_factory=Problems)
    sections: dict[str, Any] = field(default_factory=dict)

    def complain(self, path: PathKeys, message: str, cure: str = "") -> None:
        """Note a problem at a path."""
        entry, _ = self.root.nearest(path)
        self.problems.add(entry.origin, path, message, cure)

    def warn(self, path: PathKeys, message: str, cure: str = "") -> None:
        """Note something that is likely a mistake and still can be run."""
        entry, _ = self.root.nearest(path)
        self.warnings.add(entry.origin, path, message, cure)

    def _complain_of(
        self, error: ValidationError, path: PathKeys, model: type[BaseModel], owner: str
    ) -> None:
        details = [detail for detail in error.errors() if not (self.incomplete and is_missing_key(detail))]
        complain(details, self.root, path, model, owner, self.problems)

    def names(self, section: str) -> list[str]:
        """Return the names of the nodes of a section, in the order of the file."""
        entry = self.root.mapping.get(section)
        return list(entry.mapping) if entry is not None else []

    def check_sections(self) -> None:
        """Fill ``sections`` with what the schema accepts, and note what it does not."""
        data = self.root.plain()
        try:
            whole = TopologyFile.model_validate_json(json.dumps(data))
        except ValidationError as error:
            self._complain_of(error, (), TopologyFile, "the topology")
            faulty = {detail["loc"][0] for detail in error.errors()}
            for key, info in TopologyFile.model_fields.items():
                if key in data and key not in faulty:
                    adapter: TypeAdapter[Any] = TypeAdapter(info.rebuild_annotation())
                    self.sections[key] = adapter.validate_json(json.dumps(data[key]))
                elif key not in data and not info.is_required():
                    self.sections[key] = info.get_default(call_default_factory=True)
            return
        self.sections = {key: getattr(whole, key) for key in TopologyFile.model_fields}

    def check_kind(
        self, role: Role, name: str, path: PathKeys, parameters_path: PathKeys, stated: Mapping[str, Any]
    ) -> CheckedKind | None:
        """Return a kind with its parameters checked, None when something is wrong with it (noted).

        ``path`` is where the kind is named, ``parameters_path`` where its parameters stand.
        """
        entry, _ = self.root.nearest(path)
        try:
            found = find_kind(role, name, entry.origin.directory)
            model = parameters_model(found, role)
        except UnknownKindError as error:
            cure = f"{did_you_mean(name, error.known)} (or give module:Class or ./file.py:Class)"
            self.complain(path, str(error), cure)
            return None
        except KindError as error:
            self.complain(path, str(error))
            return None
        try:
            filled: Parameters = fill(model, stated)
        except ValidationError as error:
            self._complain_of(error, parameters_path, model, f"{role[:-1]} {name}")
            return None
        return CheckedKind(found, values(filled), plain(filled))

    def check_node_kind(self, section: str, path: PathKeys) -> CheckedKind | None:
        """Return the kind of the plant, or of a node of a section; ``path`` is that of the node."""
        entry, found = self.root.nearest(path)
        named = entry.mapping.get(KIND_KEYS[section])
        if found != path or named is None or not isinstance(named.value, str):
            return None
        own = _OWN_KEYS[section]
        stated = {key: member.plain() for key, member in entry.mapping.items() if key not in own}
        return self.check_kind(_ROLES[section], named.value, (*path, KIND_KEYS[section]), path, stated)
