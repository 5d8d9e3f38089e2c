"""Every mistake in a topology is told with its line and a cure, and all mistakes at once."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from orchestrator.topology.load import TopologyError, find_problems, load_topology
from tests.orchestrator.topology.small import GOOD

SENSORS = "  s1..s4: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}"
ESTIMATORS = "  e1..e4: {method: secure_distributed, coupling: 0.01, threshold: 9}"

LAW = """\
import numpy as np


class Law:
    def __init__(self, setting):
        pass

    def control(self, step, state):
        return np.zeros(1)
"""


@dataclass(frozen=True)
class Bad:
    """A change to the good topology, and the words and the line of the problem that it makes.

    ``old`` is replaced by ``new``; an empty ``old`` appends, and ``whole`` replaces everything.
    """

    old: str
    new: str
    words: tuple[str, ...]
    line: int
    whole: bool = False
    files: dict[str, str] = field(default_factory=dict)


def appended(text: str, *words: str, line: int = 14, files: dict[str, str] | None = None) -> Bad:
    return Bad("", text, words, line, files=files or {})


def whole(text: str, *words: str, line: int) -> Bad:
    return Bad("", text, words, line, whole=True)


BAD: dict[str, Bad] = {
    # The file itself
    "empty file": whole("", "the file is empty", line=0),
    "only a comment": whole("# nothing\n", "the file is empty", line=0),
    "not a mapping": whole("- 1\n- 2\n", "the file is not a mapping", line=1),
    "two documents": whole(GOOD + "---\nsteps: 3\n", "not YAML", "single document", line=14),
    "open bracket": Bad("graph: {ring: {nodes: 4}}", "graph: {ring: {nodes: 4}", ("not YAML",), 12),
    "tab": Bad("  process_noise", "\tprocess_noise", ("not YAML", "spaces, not with tabs"), 5),
    "unquoted star": Bad("e*->e*:", "*->*:", ("not YAML", 'in quotes, for example "*->e4"'), 13),
    "duplicate key": appended("steps: 30\n", "steps: the key 'steps' is there twice, first in line 2"),
    "key that is a number": Bad(SENSORS, "  1: {model: linear}", ("the key '1' is not text", "quotes"), 8),
    "tag": Bad("steps: 20", "steps: !!python/int 20", ("tag", "not allowed"), 2),
    "alias of itself": appended("attacks: &a [*a]\n", "an alias contains itself"),
    # Keys, types and bounds
    "unknown key": Bad("steps:", "stepz:", ("no key 'stepz'", "did you mean 'steps'?"), 2),
    "missing key": Bad("steps: 20\n", "", ("needs the key 'steps'",), 1),
    "empty value": Bad("steps: 20", "steps:", ("needs the key 'steps'",), 1),
    "text for a number": Bad("steps: 20", "steps: many", ('steps: "many" is not a whole number',), 2),
    "fraction of a step": Bad("steps: 20", "steps: 20.5", ("20.5 is not a whole number",), 2),
    "truth value for a number": Bad("period_s: 0.1", "period_s: true", ("true is not a number",), 1),
    "negative steps": Bad("steps: 20", "steps: -20", ("is -20, must be at least 1",), 2),
    "negative period": Bad("period_s: 0.1", "period_s: -0.1", ("is -0.1, must be more than 0",), 1),
    "not a number": Bad("period_s: 0.1", "period_s: .nan", ("period_s", ".nan is not a finite number"), 1),
    "infinite number": Bad("std: 0.2", "std: .inf", ("plant.process_noise.std: .inf is not a finite",), 5),
    "negative seed": appended("seed: -1\n", "seed: is -1, must be at least 0"),
    "large seed": appended(f"seed: {2**53 + 1}\n", "beyond 2^53"),
    "name with a slash": appended("name: a/b\n", "name: ", "is not a name"),
    "unknown process key": appended("process: {windw: 3}\n", "no key 'windw'", "'window'"),
    "unknown backend": appended("process: {backend: inproces}\n", "backend", "did you mean 'inprocess'?"),
    "outliving nobody": appended(
        "process: {on_crash: {s9: silence}}\n", "there is no node 's9'", "there is: s1"
    ),
    "outliving the plant": appended("process: {on_crash: {plant: silence}}\n", "without the plant"),
    "unknown crash policy": appended("process: {on_crash: {s1: silent}}\n", "on_crash", "'silence'"),
    "unknown score key": appended("score: {from_stp: 3}\n", "no key 'from_stp'", "'from_step'"),
    "impossible score": appended("score: {confidence: 2.0}\n", "score: ", "confidence between 0 and 1"),
    # Names and ranges
    "backward range": Bad("s1..s4:", "s4..s1:", ("the range 's4..s1' runs backwards", "write s1..s4"), 8),
    "range of two prefixes": Bad("s1..s4:", "s1..t4:", ("'s1..t4' is not a range",), 8),
    "range without end": Bad("s1..s4:", "s1..:", ("'s1..' is not a range",), 8),
    "overlapping ranges": Bad(SENSORS, f"{SENSORS}\n{SENSORS.replace('s1..', 's3..')}", ("both hold s3",), 9),
    "same node twice": Bad(SENSORS, f"{SENSORS}\n{SENSORS.replace('s1..s4', 's2')}", ("both hold s2",), 9),
    "name with a dollar": Bad("s1..s4:", "s$1:", ("'s$1' is not a name",), 8),
    "name with a star": Bad("s1..s4:", "s*:", ("'s*' is not a name",), 8),
    "empty name": Bad("s1..s4:", '"":', ("a name is empty",), 8),
    "reserved name": Bad("e1..e4:", "plant:", ("'plant' is a reserved word",), 10),
    "sensor named as an estimator": Bad(
        ESTIMATORS, f"{ESTIMATORS}\n  s1: {{method: kalman}}", ("both a sensor and an estimator",), 11
    ),
    # Kinds and their parameters
    "unknown plant": Bad("constant_acceleration", "constant_aceleration", ("did you mean 'constant_a",), 4),
    "unknown sensor": Bad("model: linear", "model: lineal", ("sensor kind 'lineal'", "mean 'linear'"), 8),
    "unknown method": Bad("secure_distributed", "kalmann", ("estimator kind", "did you mean 'kalman'?"), 10),
    "unknown impairment": Bad("bernoulli", "bernouli", ("impairment kind", "did you mean 'bernoulli'?"), 13),
    "unknown graph": Bad("ring:", "rign:", ("graph kind 'rign'", "did you mean 'ring'?"), 11),
    "kind without name": Bad("model: linear, ", "", ("each of the sensors needs the key 'model'",), 8),
    "unknown parameter": Bad("coupling:", "copling:", ("no key 'copling'", "did you mean 'coupling'?"), 10),
    "unknown inner key": Bad("noise: {std: 0.1}", "noise: {sdt: 0.1}", ("no key 'sdt'", "'std'"), 8),
    "missing parameter": Bad(", coupling: 0.01", "", ("secure_distributed needs the key 'coupling'",), 10),
    "parameter of another type": Bad("coupling: 0.01", "coupling: strong", ('"strong" is not a number',), 10),
    "parameter out of bounds": Bad("coupling: 0.01", "coupling: -1", ("is -1, must be at least 0",), 10),
    "probability over one": Bad("loss: 0.1", "loss: 1.1", ("is 1.1, must be at most 1",), 13),
    "null parameter": Bad("coupling: 0.01", "coupling: null", ("needs the key 'coupling'",), 10),
    "no such file": Bad("secure_distributed", "./mine.py:Mine", ("there is no file", "mine.py"), 10),
    "no such class": Bad(
        "secure_distributed",
        "./mine.py:Mine",
        ("has no class 'Mine'",),
        10,
        files={"mine.py": "class Yours: pass\n"},
    ),
    "broken file": Bad(
        "secure_distributed",
        "./mine.py:Mine",
        ("cannot be imported: Syntax",),
        10,
        files={"mine.py": "class\n"},
    ),
    "file that needs another": Bad(
        "secure_distributed",
        "./mine.py:Mine",
        ("No module named 'yours'", "a file stands alone"),
        10,
        files={"mine.py": "import yours\n", "yours.py": ""},
    ),
    "no such module": Bad("secure_distributed", "no_such_module:Mine", ("cannot be imported",), 10),
    # What only the classes know
    "ragged matrix": Bad("C: [[1.0, 0.0, 0.0]]", "C: [[1.0, 0.0], [1.0]]", ("rows of lengths [2, 1]",), 8),
    "matrix of another width": Bad("C: [[1.0, 0.0, 0.0]]", "C: [[1.0, 0.0]]", ("3 entries",), 8),
    "indefinite covariance": Bad(
        "initial: {std: 1.0}",
        "initial: {covariance: [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}",
        ("positive semidefinite",),
        3,
    ),
    "std and covariance": Bad(
        "noise: {std: 0.1}", "noise: {std: 0.1, covariance: [[1.0]]}", ("exactly one",), 8
    ),
    "half a chain": Bad("{bernoulli: {loss: 0.1}}", "{gilbert_elliott: {failure: 0.1}}", ("'recovery'",), 13),
    # Sensors, graph
    "unknown sensor to listen to": Bad(
        "coupling: 0.01", "coupling: 0.01, sensors: [s9]", ("no sensor 's9'",), 10
    ),
    "no sensors": Bad(f"sensors:\n{SENSORS}\n", "", ("no sensors for e1", "sensors: []"), 8),
    "no estimators": Bad(GOOD[GOOD.index("estimators:") :], "estimators: {}\n", ("are no estimators",), 9),
    "unpaired estimator": Bad("  s1..s4:", "  s2..s4:", ("e1 has no sensor with number 1",), 10),
    "neither sensor nor neighbour": Bad(
        f"{ESTIMATORS}\ngraph: {{ring: {{nodes: 4}}}}",
        f"{ESTIMATORS}\n  k1: {{method: kalman, sensors: []}}\ngraph: {{ring: {{nodes: 4}}}}",
        ("k1 has neither a sensor nor a neighbour",),
        11,
    ),
    "graph of another size": Bad("nodes: 4", "nodes: 5", ("nodes 1 to 5, and e1..e4 are 4 estimators",), 11),
    "no graph": Bad("graph: {ring: {nodes: 4}}\n", "", ("there is no graph", "ring: {nodes: 4}"), 10),
    "two graphs": Bad("{ring: {nodes: 4}}", "{ring: {nodes: 4}, edges: []}", ("exactly one way",), 11),
    "ring too dense": Bad("nodes: 4", "nodes: 4, neighbours: 4", ("an even number less than nodes",), 11),
    "self loop": Bad("{ring: {nodes: 4}}", "{edges: [[1, 1]]}", ("1 is linked with itself",), 11),
    "edge to a stranger": Bad("{ring: {nodes: 4}}", "{edges: [[1, 7]]}", ("there is no e7",), 11),
    "edge to an unknown name": Bad("{ring: {nodes: 4}}", "{edges: [[e1, f7]]}", ("no estimator 'f7'",), 11),
    "edge twice": Bad("{ring: {nodes: 4}}", "{edges: [[1, 2], [2, 1]]}", ("[2, 1] is there twice",), 11),
    "edge of one end": Bad("{ring: {nodes: 4}}", "{edges: [[1]]}", ("[1] is not an edge",), 11),
    "negative weight": Bad("{ring: {nodes: 4}}", "{edges: [[1, 2, -0.5]]}", ("not a positive number",), 11),
    "some weights": Bad("{ring: {nodes: 4}}", "{edges: [[1, 2, 0.5], [2, 3]]}", ("some have none",), 11),
    "no GraphML": Bad("{ring: {nodes: 4}}", "{graphml: mesh.xml}", ("there is no file 'mesh.xml'",), 11),
    "bad GraphML": Bad(
        "{ring: {nodes: 4}}", "{graphml: m.xml}", ("'m.xml' is not GraphML",), 11, files={"m.xml": "<graph>"}
    ),
    "rounds that do not match": Bad(
        ESTIMATORS,
        "  e1..e3: {method: secure_distributed, coupling: 0.01}\n"
        "  e4: {method: external, command: [./mine], rounds: 2}",
        ("exchange rounds a step differ",),
        11,
    ),
    # Channel and attacks
    "pattern without arrow": Bad("e*->e*:", "e*:", ("'e*' is not a link",), 13),
    "pattern of nobody": Bad("e*->e*:", "f*->e*:", ("there is no sender 'f*'",), 13),
    "pattern without link": Bad("e*->e*:", "e1->e3:", ("there is no link e1->e3", "e2->e3"), 13),
    "two kinds in a stage": Bad("{loss: 0.1}", "{loss: 0.1}, perfect: {}", ("exactly one kind",), 13),
    "option beside the kind": Bad("{loss: 0.1}", "{loss: 0.1}, scope: shared", ("all else inside it",), 13),
    "unknown scope": Bad("loss: 0.1", "loss: 0.1, scope: everyone", ("'per_link' or 'shared'",), 13),
    "unknown placeholder": Bad("loss: 0.1", 'loss: 0.1, stream: "{me}"', ("placeholder", "{source}"), 13),
    "attack in the channel": Bad(
        "{bernoulli: {loss: 0.1}}", "{bias: {value: 1}}", ("bias is an attack",), 13
    ),
    "attack on nobody": appended("attacks: [{bias: {value: 1}, on: s9->e1}]\n", "there is no sender 's9'"),
    "attack on no link": appended("attacks: [{bias: {value: 1}, on: s1->e2}]\n", "no link s1->e2", "s2->e2"),
    "attack without kind": appended("attacks: [{on: s1->e1}]\n", "exactly one kind, here: none"),
    "attack nowhere": appended("attacks: [{bias: {value: 1}}]\n", "needs the key 'on'"),
    "attack after the end": appended(
        "attacks: [{bias: {value: 1}, on: s1->e1, steps: [18, 20]}]\n", "leaves the run", "0 to 19"
    ),
    "attack backwards": appended(
        "attacks: [{bias: {value: 1}, on: s1->e1, steps: [9, 5]}]\n", "runs backwards", "[5, 9]"
    ),
    "attack of one step number": appended(
        "attacks: [{bias: {value: 1}, on: s1->e1, steps: [9]}]\n", "[9] is not a window"
    ),
    "overlapping windows": appended(
        "attacks: [{bias: {value: 1}, on: s1->e1, steps: [[1, 5], [5, 9]]}]\n", "overlap"
    ),
    "two attacks of one name": appended(
        "attacks:\n"
        "  - {bias: {value: 1}, on: s1->e1, name: a}\n"
        "  - {bias: {value: 1}, on: s2->e2, name: a}\n",
        "the name 'a' is taken",
        line=16,
    ),
    "two unlike chains of one name": Bad(
        "  e*->e*: {bernoulli: {loss: 0.1}}",
        "  s*->e*: {bernoulli: {loss: 0.2, stream: air}}\n  e*->e*: {bernoulli: {loss: 0.1, stream: air}}",
        ("two unlike chains of bernoulli share the stream 'air'",),
        14,
    ),
    # When, what it knows, and how packets are sealed
    "unknown schedule": appended(
        "attacks: [{bias: {value: 1}, on: s1->e1, when: {sometimes: {}}}]\n", "no schedule kind 'sometimes'"
    ),
    "two schedules": appended(
        "attacks: [{bias: {value: 1}, on: s1->e1, when: {periodic: {every: 2}, bernoulli: {}}}]\n",
        "exactly one schedule",
    ),
    "probability over 1": appended(
        "attacks: [{bias: {value: 1}, on: s1->e1, when: {bernoulli: {probability: 1.5}}}]\n", "at most 1"
    ),
    "alarm of nobody": appended(
        "attacks: [{bias: {value: 1}, on: s1->e1, when: {alarm: {of: e9}}}]\n", "no estimator 'e9'"
    ),
    "trigger without delay": appended(
        "attacks: [{bias: {value: 1}, on: s1->e1, when: {alarm: {of: e1, delay: 0}}}]\n", "at least 1"
    ),
    "unknown grant": appended("adversary: {knows: [everything]}\n", "'topology', 'model'"),
    "unknown seal": appended("integrity: {s1: rot13}\n", "'none', 'crc' or 'mac'"),
    "seal of nobody": appended("integrity: {s9: mac}\n", "there is no node 's9'"),
    "signal on a link": appended(
        "attacks: [{signal: {value: [1]}, on: s1->e1}]\n", "enters the plant and its sensors"
    ),
    "signal into a plant without G": appended(
        "attacks: [{signal: {value: [1]}, on: plant}]\n", "a signal of 1 components for a plant that takes 0"
    ),
    "signal by trigger": appended(
        "attacks: [{signal: {value: [1]}, on: plant, when: {alarm: {of: e1}}}]\n", "cannot wait for a trigger"
    ),
    "crash of a link": appended("attacks: [{crash: {}, on: s1->e1}]\n", "there is no node 's1->e1'"),
    "crash of nobody": appended("attacks: [{crash: {}, on: s9}]\n", "there is no node 's9'"),
    "crash that ends": appended(
        "attacks: [{crash: {}, on: s1, steps: [[2, 3], [5, 6]]}]\n", "lasts to the end of the run"
    ),
    "crash of everybody": appended("attacks: [{crash: {}, on: '*'}]\n", "every sender falls silent"),
    "controller of nobody": appended(
        "controllers: {c1: {law: './law.py:Law', estimator: e9}}\n",
        "there is no estimator 'e9'",
        files={"law.py": LAW},
    ),
    "controller without input": Bad(
        "",
        "controllers: {c1: {law: './law.py:Law', estimator: e1}}\n",
        ("the plant has no input for the controllers",),
        3,
        files={"law.py": LAW},
    ),
    "two controllers": appended(
        "controllers:\n"
        "  c1: {law: './law.py:Law', estimator: e1}\n"
        "  c2: {law: './law.py:Law', estimator: e2}\n",
        "the plant has two controllers",
        line=16,
        files={"law.py": LAW},
    ),
    # Expectations
    "unknown metric": appended("expect: {rmse.positon: 1}\n", "no metric 'rmse.positon'", "'rmse.position'"),
    "expectation of nobody": appended(
        "expect: {rmse.position: {node: e9, at_most: 1}}\n", "no estimator 'e9'", "there is: e1, e2"
    ),
    "expectation of nothing": appended("expect: {rmse.position: {node: e1}}\n", "expects nothing"),
    "empty interval": appended(
        "expect: {rmse.position: {at_least: 2, at_most: 1}}\n", "nothing is at least 2 and at most 1"
    ),
    "link of a node's metric": appended(
        "expect: {rmse.position: {link: s1->e1, at_most: 1}}\n", "not a figure of a link"
    ),
    # Inheritance
    "extends a missing file": appended("extends: base.yml\n", "there is no file 'base.yml'", "topology.yaml"),
    "extends itself": appended("extends: topology.yaml\n", "in a circle"),
    "extends a circle": Bad(
        "",
        "extends: a.yaml\n",
        ("in a circle", "topology.yaml -> "),
        1,
        files={"a.yaml": "extends: topology.yaml\n"},
    ),
    "extends a list": appended("extends: [a, b]\n", "is not the path of a file"),
    "extends an empty file": Bad("", "extends: a.yaml\n", ("the file is empty",), 0, files={"a.yaml": ""}),
}


def written(folder: Path, text: str, files: dict[str, str]) -> Path:
    for name, content in files.items():
        (folder / name).write_text(content)
    path = folder / "topology.yaml"
    path.write_text(text)
    return path


def test_the_good_topology_is_good(tmp_path: Path) -> None:
    assert find_problems(written(tmp_path, GOOD, {})) == ((), ())


@pytest.mark.parametrize("name", BAD)
def test_a_mistake_is_told_once_with_its_line(name: str, tmp_path: Path) -> None:
    bad = BAD[name]
    assert bad.old in GOOD
    text = bad.new if bad.whole else GOOD.replace(bad.old, bad.new, 1) if bad.old else GOOD + bad.new
    with pytest.raises(TopologyError) as caught:
        load_topology(written(tmp_path, text, bad.files))
    (problem,) = caught.value.problems
    for words in bad.words:
        assert words in str(problem)
    assert problem.line == bad.line


def test_all_mistakes_are_told_at_once(tmp_path: Path) -> None:
    text = (
        GOOD.replace("steps: 20", "stepz: 20")
        .replace("std: 0.2", "sdt: 0.2")
        .replace("model: linear", "model: lineal")
        .replace("coupling: 0.01", "coupling: strong")
        .replace("loss: 0.1", "loss: 2")
        .replace("ring: {nodes: 4}", "ring: {size: 4}")
        + "attacks: [{bias: {value: 1}, on: s9->e1}, {bias: {valu: 1}, on: s1->e1}]\nseed: -1\n"
    )
    errors, _ = find_problems(written(tmp_path, text, {}))
    assert [error.line for error in errors] == [2, 5, 8, 10, 11, 11, 13, 14, 14, 15]


_SCALARS = st.sampled_from(
    [None, True, -1, 0, 3, 0.5, 1e300, "", "e*", "s1->e1", "s1..s3", "kalman", "{", "a:b"]
)
_VALUES = st.recursive(
    _SCALARS,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["nodes", "bernoulli", "std", "on", "e1", "steps", "x:y"]), inner, max_size=3
        )
    ),
    max_leaves=6,
)


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    members = (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    )
    return [path] + [place for key, inner in members for place in _places(inner, (*path, key))]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_whatever_is_written_is_run_or_refused_in_words(data: st.DataObject, tmp_path: Path) -> None:
    tree = YAML(typ="safe", pure=True).load(GOOD)
    tree["attacks"] = [{"bias": {"value": 1}, "on": "s1->e1", "steps": [1, 2]}]
    tree["expect"] = {"rmse.position": {"node": "e1", "at_most": 1}}
    tree["score"] = {"from_step": 1}
    for _ in range(data.draw(st.integers(1, 3))):
        *folders, last = data.draw(st.sampled_from([place for place in _places(tree) if place]))
        target = tree
        for key in folders:
            target = target[key]
        target[last] = data.draw(_VALUES)
    errors, _ = find_problems(written(tmp_path, json.dumps(tree), {}))
    assert all(error.message for error in errors)


def test_a_group_of_nodes_is_told_of_once(tmp_path: Path) -> None:
    text = GOOD.replace("C: [[1.0, 0.0, 0.0]]", "C: [[1.0]]")
    errors, _ = find_problems(written(tmp_path, text, {}))
    assert len(errors) == 1


def test_a_problem_of_a_base_is_told_in_the_base(tmp_path: Path) -> None:
    path = written(tmp_path, "extends: _base.yaml\n", {"_base.yaml": GOOD.replace("steps: 20", "steps: 0")})
    ((problem,), _) = find_problems(path)
    assert Path(problem.file).name == "_base.yaml"
    assert problem.line == 2


def test_a_base_is_refused_by_run_and_may_be_incomplete(tmp_path: Path) -> None:
    base = tmp_path / "_base.yaml"
    base.write_text(GOOD.replace("steps: 20\n", ""))
    (tmp_path / "case.yaml").write_text("extends: _base.yaml\nsteps: 3\n")
    assert find_problems(base) == ((), ())
    with pytest.raises(
        TopologyError, match=r"is a base for other topologies\n *run a file that .*: case.yaml"
    ):
        load_topology(base)


@pytest.mark.parametrize(
    ("old", "new", "warning"),
    [
        ("{ring: {nodes: 4}}", "{edges: [[1, 2], [3, 4]]}", "nothing of e1 ever reaches e3"),
        (
            "{ring: {nodes: 4}}",
            "{edges: [[1, 2], [2, 3], [3, 4]], directed: true}",
            "nothing of e2 ever reaches e1",
        ),
        ("  s1..s4:", "  s1..s5:", "nobody listens to s5"),
        (
            "{method: secure_distributed, coupling: 0.01, threshold: 9}",
            "{method: kalman}",
            "the graph is not used",
        ),
        (
            ESTIMATORS,
            ESTIMATORS.replace("e1..e4", "e1..e3")
            + "\n  e4: {method: fixed_gain_consensus, coupling: 0.01, gain: [0.4, 0.5, 0.4]}",
            "do not share one method",
        ),
        ("  e*->e*: {", "  e1->e2: perfect\n  e*->e*: {", "no link is left to 'e1->e2'"),
    ],
)
def test_what_is_likely_a_mistake_is_warned_of(old: str, new: str, warning: str, tmp_path: Path) -> None:
    text = GOOD.replace(old, new)
    if "kalman" in new:
        text = text[: text.index("channel:")]
    errors, warnings = find_problems(written(tmp_path, text, {}))
    assert errors == ()
    assert [warning in str(problem) for problem in warnings] == [True]


def test_a_folder_is_no_topology_and_the_cure_says_what_takes_folders(tmp_path: Path) -> None:
    with pytest.raises(
        TopologyError, match=r"is a folder\n *name a file in it; 'gauntlet test' takes folders"
    ):
        load_topology(tmp_path)


def test_a_graph_without_edges_is_no_mistake_where_nobody_exchanges(tmp_path: Path) -> None:
    text = GOOD.replace("{ring: {nodes: 4}}", "{edges: []}")
    text = text.replace("{method: secure_distributed, coupling: 0.01, threshold: 9}", "{method: kalman}")
    errors, warnings = find_problems(written(tmp_path, text[: text.index("channel:")], {}))
    assert (errors, warnings) == ((), ())
