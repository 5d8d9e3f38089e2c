from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from orchestrator import exit_codes
from orchestrator.errors import InputError
from orchestrator.log.reader import read_log
from orchestrator.testing.finding import find_files
from orchestrator.testing.junit import junit_xml
from orchestrator.testing.suite import FileResult, Options, exit_code, run_file, run_files
from tests.orchestrator.testing.conftest import check_junit


@pytest.fixture
def options(tmp_path: Path) -> Options:
    logs = tmp_path / "logs"
    logs.mkdir()
    return Options(logs)


def _laid_out(folder: Path, names: Iterable[str], text: str = "extends: base.yaml\n") -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def test_a_folder_is_searched_to_its_depth_for_topologies_that_are_no_bases(tmp_path: Path) -> None:
    wanted = ["a.yaml", "deep/c.yaml", "deep/er/b.yml"]
    others = ["_base.yaml", ".git/d.yaml", "notes.txt", "runs/x-1/run.mcap", "runs/x-1/topology.yaml"]
    others += ["out/campaign.json", "out/topologies/variant-000.yaml", ".hidden.yaml"]
    others += [
        "runs/x-2/topology.yaml",
        "runs/x-2/score.json",
        "runs/x-3/topology.yaml",
        "runs/x-3/timing.json",
    ]
    others += ["venv/pyvenv.cfg", "venv/share/e.yaml", "conda/conda-meta/history", "conda/f.yaml"]
    others += ["node_modules/pack/g.yaml", "lib/site-packages/pack/h.yaml"]
    _laid_out(tmp_path, [*wanted, *others])
    assert [path.relative_to(tmp_path).as_posix() for path in find_files([tmp_path])] == wanted
    assert find_files([tmp_path / "a.yaml", tmp_path]) == find_files([tmp_path])
    assert [path.name for path in find_files([tmp_path], "deep")] == ["c.yaml", "b.yml"]
    assert [path.name for path in find_files([tmp_path], "d*c.y")] == ["c.yaml"]


@pytest.mark.parametrize(
    ("text", "is_run"),
    [
        ("site_name: x\nnav:\n  - sensors: s.md\nplugins: {search: {extends: no}}\n", False),
        ("name: ci\non: [push]\njobs: {}\nsteps: 3\nsed: 1\n", False),
        ("- plant\n- sensors\n", False),
        ("{{ range .Values.sensors }}\nplant: 1: 2\n", False),
        ("", False),
        ("# a comment\n---\n{name: x, 'sensors': {}}\n", True),
        ("name: x\nplant: {model: nothing of the kind\n", True),
        ("name: x\nestimators : {}\n", True),
        ("\ufeff'extends': base.yaml\n", True),
    ],
)
def test_a_yaml_file_that_is_no_topology_is_passed_over_in_a_folder_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, is_run: bool
) -> None:
    _laid_out(tmp_path, ["own.yaml"])
    other = tmp_path / "other.yaml"
    other.write_text(text)
    assert (other in find_files([tmp_path])) == is_run
    told = capsys.readouterr().err
    assert (told == "") == is_run
    if not is_run:
        assert told == (
            f"passed over {other}, without any of the keys 'extends', 'plant', 'sensors', 'estimators'; "
            "name one outright to run it\n"
        )
    assert find_files([other]) == [other], "what is named outright is run"
    assert other in find_files([tmp_path, other])
    assert capsys.readouterr().err == ""


def test_many_files_that_are_no_topologies_are_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _laid_out(tmp_path, ["own.yaml"])
    _laid_out(tmp_path, [f"chart{i}.yaml" for i in range(9)], "kind: Service\n")
    find_files([tmp_path])
    (line,) = capsys.readouterr().err.splitlines()
    assert "chart2.yaml and 6 more, without any of the keys" in line
    find_files([tmp_path], "own")
    assert capsys.readouterr().err == "", "-k asks for others"


def test_paths_that_lead_to_no_file_are_refused(tmp_path: Path, tmp_path_factory: Any) -> None:
    foreign = tmp_path_factory.mktemp("foreign")
    (foreign / "mkdocs.yml").write_text("site_name: x\n")
    for paths, pattern, words in [
        ([tmp_path / "none.yaml"], "", "does not exist"),
        ([tmp_path], "", "holds no topology file: none ends in .yaml"),
        ([foreign], "", r"holds no topology file, only .*mkdocs.yml, without any of the keys 'extends'"),
        ([Path(__file__)], "qqq", "has 'qqq' in its path"),
    ]:
        with pytest.raises(InputError, match=words):
            find_files(paths, pattern)


def test_a_file_that_keeps_its_promises_leaves_no_log(calm: Path, options: Options) -> None:
    result = run_file(calm / "calm.yaml", options)
    assert [case.passed for case in result.cases] == [True, True]
    assert result.cases[1].title == "rmse.position at most 0.2 of e1, e2"
    assert (result.error, result.exit_code, result.log) == ("", exit_codes.PASSED, None)
    assert not list(options.logs.iterdir())


def test_a_file_that_breaks_a_promise_tells_the_numbers_and_keeps_the_log(
    calm: Path, options: Options
) -> None:
    bad = calm / "bad.yaml"
    bad.write_text("extends: calm.yaml\nexpect: {rmse.position: {node: e1, at_most: 0.001}}\n")
    result = run_file(bad, options)
    assert result.exit_code == exit_codes.EXPECTATION_FAILED
    (failure,) = result.failures
    assert failure.message.startswith("rmse.position at most 0.001: 0.")
    assert result.log is not None
    assert read_log(result.log).complete


def test_each_backend_gives_the_same_verdicts(calm: Path, options: Options) -> None:
    by_backend = [
        run_file(calm / "attacked.yaml", Options(options.logs, backend)).cases
        for backend in ("inprocess", "processes")
    ]
    assert by_backend[0] == by_backend[1]
    assert len(by_backend[0]) == 2


def test_a_seed_replaces_that_of_the_file(calm: Path, options: Options) -> None:
    strict = calm / "strict.yaml"
    strict.write_text("extends: calm.yaml\nseed: 3\nexpect: {rmse.position: {node: e1, at_most: 0.001}}\n")
    messages = {
        seed: run_file(strict, Options(options.logs, seed=seed)).failures[0].message for seed in (None, 3, 4)
    }
    assert messages[None] == messages[3] != messages[4]


def _many(folder: Path) -> list[Path]:
    texts = {
        "bad.yaml": "extends: calm.yaml\nexpect: {rmse.position: {node: e1, at_most: 0.001}}\n",
        "broken.yaml": "extends: calm.yaml\nsteppes: 3\n",
        "raises.yaml": "extends: calm.yaml\nestimators: {e2: {method: './raising.py:Raising'}}\n",
        "silent.yaml": "extends: calm.yaml\nexpect: null\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    return find_files([folder])


def test_the_xml_holds_a_case_for_each_expectation_and_tells_failures_and_errors(
    calm: Path, options: Options
) -> None:
    results = list(run_files(_many(calm), options))
    root = check_junit(junit_xml(results))
    suites = {Path(suite.attrib["name"]).name: suite for suite in root}
    assert list(suites) == [
        *("attacked.yaml", "bad.yaml", "broken.yaml", "calm.yaml", "raises.yaml", "silent.yaml")
    ]
    assert [case.attrib["name"] for case in suites["calm.yaml"]] == [
        "divergences exactly 0",
        "rmse.position at most 0.2 of e1, e2",
    ]
    (failure,) = suites["bad.yaml"].iter("failure")
    assert "rmse.position at most 0.001: 0." in failure.attrib["message"]
    assert "run.mcap" in str(failure.text)
    (unread,) = suites["broken.yaml"].iter("error")
    assert unread.attrib["type"] == "bad input"
    assert "broken.yaml:2" in unread.attrib["message"]
    (raised,) = suites["raises.yaml"].iter("error")
    assert raised.attrib["type"] == "failed run"
    assert "e2 failed in step 7: ArithmeticError: out of" in raised.attrib["message"]
    assert "raising.py" in str(raised.text), "the traceback is there"
    (skipped,) = suites["silent.yaml"].iter("skipped")
    assert skipped.attrib["message"] == "it states none"
    assert exit_code(results) == exit_codes.RUN_FAILED


def test_several_at_a_time_come_to_the_same_results_in_the_same_order(calm: Path, options: Options) -> None:
    files = _many(calm)
    one, two = (list(run_files(files, options, jobs)) for jobs in (1, 2))
    assert [(own.path, own.cases, own.exit_code) for own in one] == [
        (own.path, own.cases, own.exit_code) for own in two
    ]


SPOILING = """
from nodes.contract import Detection
from nodes.estimators.kalman import Kalman


class Swapping(Kalman):
    def estimate(self, step):
        belief = super().estimate(step)
        return type(belief)(belief.state, belief.covariance, detections=[Detection(step, "s1", 0.5, False)])


class Tidying(Kalman):
    def __init__(self, setting, *, folder: str):
        super().__init__(setting)
        self.folder = folder

    def estimate(self, step):
        for log in __import__("pathlib").Path(self.folder).rglob("spoilt*/run.mcap"):
            log.unlink()
        return super().estimate(step)
"""


@pytest.mark.parametrize(
    ("method", "words"),
    [
        (
            "{method: './spoiling.py:Swapping'}",
            "e2 failed in step 0: TypeError: detections[0].source must be",
        ),
        ("{method: './spoiling.py:Tidying', folder: '%s'}", "run.mcap cannot be read"),
    ],
)
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_run_whose_log_is_spoilt_is_the_error_of_its_file_and_the_next_is_run(
    calm: Path, options: Options, method: str, words: str, jobs: int
) -> None:
    (calm / "spoiling.py").write_text(SPOILING)
    spoilt = calm / "a_spoilt.yaml"
    spoilt.write_text(
        "name: spoilt\nextends: calm.yaml\nestimators: {e2: "
        + method.replace("%s", str(options.logs))
        + "}\n"
    )
    first, second = run_files([spoilt, calm / "calm.yaml"], options, jobs)
    assert words in first.error
    assert (first.exit_code, first.cases) == (exit_codes.RUN_FAILED, ())
    assert (second.exit_code, len(second.cases)) == (exit_codes.PASSED, 2)
    check_junit(junit_xml([first, second]))


def test_the_exit_code_is_the_gravest() -> None:
    results = [FileResult(Path("a.yaml"), exit_code=code) for code in (0, 2, 1)]
    assert exit_code(results) == exit_codes.BAD_INPUT
    assert exit_code([]) == exit_codes.PASSED
