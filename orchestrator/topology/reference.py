"""The reference in docs/reference: every key of a topology, every kind with its parameters, every metric.

``python -m orchestrator.topology.reference docs/reference`` writes it; a test holds it to the code.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from orchestrator.registry import BUILT_IN, Role, find_kind
from orchestrator.score.catalogue import METRICS
from orchestrator.topology.docstrings import docstring_of, markdown, read_docstring
from orchestrator.topology.parameters import parameters_model
from orchestrator.topology.schema import TopologyFile
from orchestrator.topology.type_words import default_words, type_words

_NOTE = (
    "<!-- Written by `python -m orchestrator.topology.reference docs/reference`; change the code instead. -->"
)
_ROLES: Mapping[Role, str] = {
    "plants": "`plant: {model: KIND, ...}`: what is estimated.",
    "sensors": "`sensors: {s1: {model: KIND, ...}}`: what measures the plant.",
    "estimators": "`estimators: {e1: {method: KIND, ...}}`: what estimates its state.",
    "controllers": "`controllers: {c1: {law: KIND, estimator: e1, ...}}`: what commands its input.",
    "graphs": "`graph: {KIND: {...}}`: which estimators exchange with which.",
    "impairments": "`channel: {LINKS: [{KIND: {...}}]}`: what the network does to packets.",
    "attacks": "`attacks: [{KIND: {...}, on: LINKS, steps: [FIRST, LAST]}]`: what adversaries do to packets.",
    "signals": "`attacks: [{KIND: {...}, on: plant}]`: what adversaries do to the plant.",
    "faults": "`attacks: [{KIND: {...}, on: NODE}]`: how nodes fail.",
    "triggers": "`sensors: {s1: {..., send: {KIND: {...}}}}`, or on estimators: which slots to fill.",
    "schedules": "`attacks: [{..., when: {KIND: {...}}}]`: when an attack acts inside its steps.",
}
_SCOPES = {
    "node": "an estimator",
    "network": "a network of estimators",
    "link": "links",
    "window": "an attack window",
    "sender": "a node with an event trigger",
}
_Schema = Mapping[str, Any]


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Return a Markdown table, with an empty line after it; nothing when it has no rows."""
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    head = list(head)
    return [f"| {' | '.join(head)} |", "|---" * len(head) + "|", *lines, ""] if lines else []


def _members(schema: _Schema, meanings: Mapping[str, str]) -> list[str]:
    """Return the table of what a mapping may hold."""
    required = schema.get("required", ())
    rows = [
        (
            f"`{name}`",
            type_words(own),
            default_words(own, required=name in required),
            markdown(own.get("description") or meanings.get(name, "")),
        )
        for name, own in schema.get("properties", {}).items()
    ]
    return _table(("key", "type", "default", "meaning"), rows)


def _named_types(definitions: Mapping[str, _Schema]) -> list[str]:
    """Return a section on each type that has a name of its own."""
    lines = []
    for name, schema in definitions.items():
        told = read_docstring(schema.get("description", ""))
        lines += [f"## {name}", "", markdown(told.prose), "", *_members(schema, told.parameters)]
    return lines


def _page(title: str, *lines: str) -> str:
    return "\n".join([_NOTE, "", f"# {title}", "", *lines]).rstrip() + "\n"


def _topology_page() -> str:
    whole = TopologyFile.model_json_schema()
    definitions = whole.pop("$defs")
    text = (
        "Every key that a topology file may hold; what the keys do together stands in "
        "[topology files](../topology.md). Keys of nodes, stages and attacks that are not listed here are "
        "parameters of their kinds."
    )
    headings = {name: key for key, own in whole["properties"].items() for name in _types_in(own)}
    whole, definitions = (_renamed(part, headings) for part in (whole, definitions))
    sections = {key: definitions[key] for key in headings.values()}
    meanings = {key: read_docstring(own["description"]).prose for key, own in sections.items()}
    return _page("Keys of a topology", text, "", *_members(whole, meanings), *_named_types(sections))


def _types_in(schema: Any) -> list[str]:
    """Return the names of the types that a schema refers to."""
    return re.findall(r"#/\$defs/(\w+)", json.dumps(schema))


def _renamed(schemas: Any, names: Mapping[str, str]) -> Any:
    """Return schemas in which types are called otherwise."""
    text = json.dumps(schemas)
    for old, new in names.items():
        text = re.sub(rf'(#/\$defs/|"){old}"', rf'\g<1>{new}"', text)
    return json.loads(text)


def _role_page(role: Role) -> str:
    lines = [_ROLES[role], ""]
    definitions: dict[str, _Schema] = {}
    for name, reference in BUILT_IN[role].items():
        found = find_kind(role, name, Path.cwd())
        schema = parameters_model(found, role).model_json_schema()
        definitions |= schema.pop("$defs", {})
        told = docstring_of(found.type)
        lines += [f"## {name}", "", markdown(told.prose), "", f"Class `{reference}`.", ""]
        lines += _members(schema, told.parameters) or ["It has no parameters.", ""]
    return _page(role.capitalize(), *lines, *_named_types(dict(sorted(definitions.items()))))


def _metrics_page() -> str:
    rows = [
        (f"`{name}`", _SCOPES[own.scope], "yes" if own.total else "no", own.meaning, own.undefined)
        for name, own in METRICS.items()
    ]
    text = (
        "What `expect:` may bound and `results` of a campaign hold; `*` stands for a state group of the "
        "plant, or `state`. How several values become one stands in [the score](../score.md)."
    )
    head = ("metric", "of", "total of a run", "meaning", "undefined where")
    return _page("Metrics", text, "", *_table(head, rows))


def _index(pages: Mapping[str, str]) -> str:
    titles = {name: text.split("\n# ")[1].partition("\n")[0] for name, text in pages.items()}
    lines = [f"- [{title}]({name})" for name, title in titles.items()]
    text = "Made from the code. `gauntlet plugins` lists the kinds that are installed on your machine."
    return _page("Reference", text, "", *lines)


def pages() -> dict[str, str]:
    """Return the text of every page by its file's name: the same on every machine."""
    made = {"topology.md": _topology_page()}
    made |= {f"{role}.md": _role_page(role) for role in _ROLES}
    made["metrics.md"] = _metrics_page()
    return {"README.md": _index(made), **made}


def main(folder: str) -> None:
    """Write all pages into a folder."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    for name, text in pages().items():
        Path(folder, name).write_text(text)


if __name__ == "__main__":
    main(*sys.argv[1:])
