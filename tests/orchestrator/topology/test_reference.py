"""The reference in docs: made from the code, and nothing left out."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from orchestrator.registry import BUILT_IN, find_kind
from orchestrator.score.catalogue import METRICS
from orchestrator.topology.docstrings import docstring_of, read_docstring
from orchestrator.topology.parameters import parameter_names, parameters_model
from orchestrator.topology.reference import pages
from orchestrator.topology.schema import TopologyFile
from orchestrator.topology.type_words import default_words, type_words

ROOT = Path(__file__).parents[3]
REFERENCE = ROOT / "docs" / "reference"
KINDS = [(role, name) for role, kinds in BUILT_IN.items() for name in kinds]


@pytest.fixture(scope="module")
def made() -> dict[str, str]:
    return pages()


def test_the_reference_in_the_docs_is_up_to_date(made: dict[str, str]) -> None:
    """Otherwise: python -m orchestrator.topology.reference docs/reference."""
    assert {path.name: path.read_text() for path in REFERENCE.iterdir()} == made


def test_every_key_metric_and_kind_is_there(made: dict[str, str]) -> None:
    for key in TopologyFile.model_fields:
        assert f"| `{key}` |" in made["topology.md"]
    for metric in METRICS:
        assert f"| `{metric}` |" in made["metrics.md"]
    for role, name in KINDS:
        assert f"\n## {name}\n" in made[f"{role}.md"]


@pytest.mark.parametrize(("role", "name"), KINDS, ids=lambda part: str(part))
def test_every_parameter_of_every_kind_is_told(role: str, name: str) -> None:
    found = find_kind(role, name, ROOT)  # type: ignore[arg-type]
    meanings = docstring_of(found.type).parameters
    names = parameter_names(parameters_model(found, role))  # type: ignore[arg-type]
    assert [parameter for parameter in names if not meanings.get(parameter)] == []


@pytest.mark.parametrize(("role", "name"), KINDS, ids=lambda part: str(part))
def test_every_parameter_has_a_meaning_of_its_own(role: str, name: str) -> None:
    found = find_kind(role, name, ROOT)  # type: ignore[arg-type]
    meanings = docstring_of(found.type).parameters
    told = [
        meanings[parameter]
        for parameter in parameter_names(parameters_model(found, role))  # type: ignore[arg-type]
        if not meanings[parameter].startswith("As for")  # which tells them one by one
    ]
    assert len(set(told)) == len(told)


def test_every_link_of_the_reference_leads_somewhere(made: dict[str, str]) -> None:
    for name, text in made.items():
        headings = {heading.lower() for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE)}
        for target in re.findall(r"\]\(([^)]+)\)", text):
            file, _, anchor = target.partition("#")
            assert (REFERENCE / file).exists(), f"{name}: {target}"
            assert not anchor or anchor in headings, f"{name}: {target}"


def test_a_docstring_is_read_by_its_parts() -> None:
    told = read_docstring(
        """Do a thing.

        At ``length``.

        Parameters
        ----------
        first, second
            Two at once,
            over two lines.
        third : float
            One.

        Raises
        ------
        ValueError
            Never.
        """
    )
    assert told.prose == "Do a thing.\n\nAt ``length``."
    both = "Two at once, over two lines."
    assert told.parameters == {"first": both, "second": both, "third": "One."}


@pytest.mark.parametrize(
    ("schema", "words", "default"),
    [
        ({"type": "number", "exclusiveMinimum": 0, "default": 1.5}, "number above 0", "`1.5`"),
        ({"anyOf": [{"type": "integer", "minimum": 2}, {"type": "null"}]}, "whole number at least 2", "none"),
        ({"type": "array", "items": {"type": "string"}, "minItems": 1}, "list of text (at least 1)", "none"),
        ({"enum": ["a", "b"], "default": "a"}, "`a`, `b`", '`"a"`'),
        (
            {"$ref": "#/$defs/Gaussian", "default": {"std": 1, "mean": None}},
            "[Gaussian](#gaussian)",
            '`{"std": 1}`',
        ),
        ({"type": "array", "items": {}, "default": [[0.0] * 30]}, "list of anything", "the kind's own"),
    ],
)
def test_types_and_defaults_are_told_in_words(schema: dict[str, object], words: str, default: str) -> None:
    assert type_words(schema) == words
    assert default_words(schema, required=False) == default
    assert default_words(schema, required=True) == "needed"
