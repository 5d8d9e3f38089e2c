"""YAML that is written without the library says to the library what was meant."""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from orchestrator.topology.yaml_text import yaml_text

_TEXT = st.text(st.characters(exclude_categories=["Cs"])) | st.sampled_from(
    ["e*->e*", "*->e4", "s4->e4", "yes", "Null", "~", "1", "1e5", "0x1", ".inf", "a: b", "a #b", "- a", "",
     " a", "a ", "my file.py:Kind", "2020-01-01", "1_000", "a, b", "\x85", "\u2028", "\U0001f600", "=", "<<"]
)  # fmt: skip
_SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False)
    | _TEXT
)
_VALUES = st.recursive(
    _SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_TEXT, inner, max_size=3)
)


@settings(deadline=None)
@given(document=st.dictionaries(_TEXT, _VALUES, max_size=4))
def test_what_is_written_is_read_back(document: dict[str, Any]) -> None:
    assert YAML(typ="safe", pure=True).load(yaml_text(document)) == document


def test_the_layout_is_for_people() -> None:
    document = {
        "name": "ding2021-case-b",
        "description": "Two sensors: both falsified.",
        "sensors": {"s1": {"model": "linear", "C": [[4.5, -0.8]], "noise": {"std": 0.05, "mean": None}}},
        "graph": {"edges": [["e1", "e2", 0.5]], "directed": True},
        "channel": {"e*->e*": [{"bernoulli": {"loss": 0.1}}]},
        "attacks": [{"bias": {"value": 15.0}, "on": ["s4->e4"], "steps": [[90, 95]]}],
        "expect": {},
    }
    assert (
        yaml_text(document)
        == """\
name: ding2021-case-b
description: "Two sensors: both falsified."
sensors:
  s1:
    model: linear
    C:
    - [4.5, -0.8]
    noise: {std: 0.05, mean: null}
graph:
  edges:
  - [e1, e2, 0.5]
  directed: true
channel:
  e*->e*:
  - bernoulli: {loss: 0.1}
attacks:
- bias: {value: 15.0}
  on: [s4->e4]
  steps:
  - [90, 95]
expect: {}
"""
    )
