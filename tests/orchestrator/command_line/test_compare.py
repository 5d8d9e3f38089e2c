"""`gauntlet compare`, from campaigns, runs and logs to verdicts."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from orchestrator.campaign.sweep import Request, prepare, sweep
from tests.orchestrator.command_line.conftest import ROOT, SMALL, Command

TRIALS = 10
FAILING = """
    def __init__(self, setting): ...

    def correct(self, step, packets):
        raise ValueError("not today")

    def exchange(self, step, round_, packets): ...

    def estimate(self, step): ...
"""


FRAGILE = """
from nodes.estimators.kalman import Kalman


class Fragile(Kalman):
    def correct(self, step, packets):
        sent = super().correct(step, packets)
        if step == 0 and packets and packets[0].values[0] > 1.0:
            self._state = self._state * float("inf")
        return sent
"""
PAIR = """
seed: 1
period_s: 0.1
steps: 20
plant:
  model: linear
  A: [[0.95]]
  process_noise: {std: 0.3}
  initial: {std: 1.0}
  state_groups: {position: [0]}
sensors:
  s1: {model: linear, C: [[1.0]], noise: {std: 0.15}}
estimators:
  e1: {method: kalman, sensors: [s1]}
  e2: {method: "./fragile.py:Fragile", sensors: [s1]}
"""


class Silent:
    """Progress that nobody watches."""

    def begin(self, total: int, done: int) -> None: ...

    def advance(self, finished: int, failed: int) -> None: ...


def campaign(directory: Path, name: str, *overrides: str, trials: int = TRIALS) -> Path:
    file = directory / "small.yaml"
    file.write_text(SMALL)
    return sweep(prepare(Request(file, trials, overrides=overrides, out=directory / name)), Silent())


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign over the noise of the plant."""
    return campaign(tmp_path_factory.mktemp("swept"), "swept", "plant.process_noise.std=0.2,3.0")


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return campaign(tmp_path_factory.mktemp("calm"), "calm", "attacks=null")


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign in which two things vary."""
    varied = ("plant.process_noise.std=0.2,3.0", "seed=1,2")
    return campaign(tmp_path_factory.mktemp("grid"), "grid", *varied, trials=1)


def test_variants_of_one_campaign_are_compared_and_the_better_is_named(
    gauntlet: Command, swept: Path
) -> None:
    answer = gauntlet("compare", swept)
    assert answer.code == 0, answer.err
    said = " ".join(answer.out.split())
    assert "std=0.2 is better than" in said
    assert "p = 0.002" in said
    assert "10 common trials" in said
    assert "median rmse.position" in said


def test_whom_an_oracle_tells_is_marked_wherever_estimators_stand_side_by_side(
    gauntlet: Command, tmp_path: Path
) -> None:
    file = ROOT / "topologies/sadeghzadeh2022/noisy_sensor.yaml"
    shown = gauntlet("sweep", file, "--trials", 1, "--set", "steps=30", "--out", tmp_path / "out", "-j", 1)
    assert shown.code == 0, shown.err
    for told in (shown.out, gauntlet("compare", tmp_path / "out", "--by", "node").out):
        marked = {name for name in ("clean", "rederived", "tracking") if f"{name} " in told}
        assert marked == {"clean", "rederived", "tracking"}
        assert "rederived particle_fdi PRIVILEGED" in told or "rederived PRIVILEGED" in told
        assert "tracking particle_fdi PRIVILEGED" not in told
        assert "tracking PRIVILEGED" not in told


def test_a_sweep_and_a_comparison_put_estimators_together_alike(gauntlet: Command, tmp_path: Path) -> None:
    file = tmp_path / "seven.yaml"
    file.write_text(
        SMALL.replace("s1..s3", "s1..s7").replace("e1..e3", "e1..e7").replace("nodes: 3", "nodes: 7")
    )
    out = tmp_path / "out"
    swept = gauntlet("sweep", file, "--trials", 3, "--out", out, "-j", 1, "--json").json()
    ((_, figures),) = swept["variants"][0]["estimators"].items()
    compared = gauntlet("compare", out, out, "--metric", "rmse.position", "--json").json()
    assert figures["rmse.position"]["median"] == compared["samples"][0]["median"]


def test_programs_get_every_number(gauntlet: Command, swept: Path, tmp_path: Path) -> None:
    out = tmp_path / "verdict.json"
    metrics = ("--metric", "rmse.state", "--metric", "divergences")
    told = gauntlet("compare", swept, *metrics, "--json", "--out", out).json()
    assert told == json.loads(out.read_bytes())
    assert [own["metric"] for own in told["comparisons"]] == ["rmse.state", "divergences"]
    errors, divergences = told["comparisons"]
    assert errors["verdict"] == "first is better"
    assert errors["p"] == 2**-9
    assert errors["p_adjusted"] == 2**-8  # two comparisons
    assert errors["low"] <= errors["difference"] <= errors["high"] < 0.0
    assert errors["trials"] == [TRIALS, TRIALS]
    assert divergences["verdict"] == "identical"


def test_one_that_diverges_in_a_rare_trial_is_not_called_equal(
    gauntlet: Command, swept: Path, tmp_path: Path
) -> None:
    (tmp_path / "fragile.py").write_text(FRAGILE)
    (tmp_path / "pair.yaml").write_text(PAIR)
    assert gauntlet("sweep", tmp_path / "pair.yaml", "--trials", 20, "--out", tmp_path / "out").code == 0
    told = gauntlet("compare", tmp_path / "out", "--by", "node", "--json").json()
    (own,) = told["comparisons"]
    diverged = own["infinite"][1]
    assert own["infinite"][0] == 0 < diverged < 10
    assert own["verdict"] == "no difference shown"
    assert own["practical_size"] is None
    shown = gauntlet("compare", tmp_path / "out", "--by", "node").out
    first = " ".join(shown.split()).split(": ")[0]
    assert f"infinite in 0 of 20 trials with e1 and in {diverged} of 20 trials with e2" in first
    assert "median |log nees.ratio|" in gauntlet("compare", swept, "--metric", "nees.ratio").out


def test_estimators_side_by_side_are_compared_by_node_and_by_method(gauntlet: Command, swept: Path) -> None:
    told = gauntlet("compare", f"{swept}#0", "--by", "node", "--json").json()
    pairs = [(own["first"], own["second"]) for own in told["comparisons"]]
    assert pairs == [("e1", "e2"), ("e1", "e3"), ("e2", "e3")]
    assert told["comparisons"][0]["verdict"] == "first is better"  # e2 is the one under attack
    answer = gauntlet("compare", f"{swept}#1", "--by", "method")
    assert answer.code == 2
    assert "name a second" in answer.err


def test_two_campaigns_are_paired_by_seed_and_trial(gauntlet: Command, swept: Path, calm: Path) -> None:
    told = gauntlet("compare", f"{swept}#plant.process_noise.std=0.2", calm, "--json").json()
    (own,) = told["comparisons"]
    assert own["paired"]
    assert own["test"] == "Wilcoxon signed-rank"
    assert own["verdict"] == "second is better"
    assert [contender["path"] for contender in told["contenders"]] == [str(swept), str(calm)]


def test_contenders_on_another_ground_are_warned_of_to_people_and_to_programs(
    gauntlet: Command, swept: Path, calm: Path, finished_run: Path
) -> None:
    said = " ".join(gauntlet("compare", swept).out.split())
    assert "Warning: they ran different plants (plant.process_noise.std differs): a difference in" in said
    assert said.index("Warning:") < said.index("is better than")
    told = gauntlet("compare", f"{swept}#1", calm, "--json").json()
    (warning,) = told["warnings"]
    assert warning.startswith(
        "they ran different plants (plant.process_noise.std is 3 for small#1, 0.2 for small)"
    )
    same = gauntlet("compare", f"{swept}#0", calm, finished_run, "--json").json()
    assert same["warnings"] == [], "the plant is the same, attacked or not, in a campaign or a run"


def test_other_seeds_are_compared_unpaired_and_said_so(gauntlet: Command, calm: Path, tmp_path: Path) -> None:
    other = campaign(tmp_path, "other", "attacks=null", "seed=8")
    said = " ".join(gauntlet("compare", calm, other).out.split())
    assert "10 and 10 trials, unpaired, since fewer than two have seed and trial in common" in said
    told = gauntlet("compare", calm, other, "--json").json()
    assert [own["paired"] for own in told["comparisons"]] == [False]
    assert told["warnings"] == []


def test_it_is_told_how_much_there_is_of_a_record_that_breaks_off(
    gauntlet: Command, finished_run: Path, cut_off: tuple[Path, int]
) -> None:
    log, steps = cut_off
    told = gauntlet("compare", log, finished_run, "--json").json()
    (remark,) = told["remarks"]
    assert remark.startswith(f"small (cut.mcap): its record is incomplete ({steps} of 24 steps); figures are")


def test_two_runs_are_too_few_and_it_says_so(gauntlet: Command, finished_run: Path) -> None:
    answer = gauntlet("compare", finished_run, finished_run / "run.mcap", "--metric", "rmse.state")
    assert answer.code == 0
    assert "identical" in answer.out
    told = gauntlet("compare", finished_run, "--by", "node", "--json").json()
    assert {own["verdict"] for own in told["comparisons"]} == {"too few trials"}
    assert told["comparisons"][0]["trials_needed"] == 7


@pytest.mark.parametrize(
    ("arguments", "cure"),
    [
        (["nowhere"], "give the directory of a run or a campaign"),
        (["{swept}", "--metric", "rmse.positon"], "did you mean 'rmse.position'"),
        (["{swept}#7", "{swept}#0"], "it has 0: plant.process_noise.std=0.2"),
        (["{swept}", "{calm}"], "name one as in"),
        (["{swept}", "--by", "colour"], "by node, method, variant, plant.process_noise.std"),
        (["{calm}"], "name a second"),
        (["{swept}", "--by", "node"], "name one as in"),
        (["{swept}", "--out", "missing/verdict.json"], "choose another --out"),
    ],
)
def test_what_cannot_be_compared_is_bad_input_with_its_cure(
    gauntlet: Command, swept: Path, calm: Path, arguments: list[str], cure: str
) -> None:
    answer = gauntlet("compare", *(part.format(swept=swept, calm=calm) for part in arguments))
    assert answer.code == 2
    assert cure in answer.err
    assert "Traceback" not in answer.err


@pytest.mark.parametrize("command", ["compare", "report"])
@pytest.mark.parametrize(
    ("arguments", "cure"),
    [
        (["{swept}#7"], "has no variant '7'; it has 0: plant.process_noise.std=0.2; 1: plant"),
        (["{swept}#std=0.2"], "has no variant 'std=0.2'; it has 0: plant.process_noise.std=0.2"),
        (
            ["{swept}", "--by", "colour"],
            "can be taken apart by node, method, variant, plant.process_noise.std",
        ),
        (["{calm}", "--by", "plant.process_noise.std"], "can be taken apart by node, method, variant"),
        (["{grid}", "--by", "seed"], "fix it as in '{grid}#plant.process_noise.std=VALUE'"),
        (["nowhere#0"], "nowhere holds no run and no campaign"),
    ],
)
def test_what_no_campaign_holds_is_refused_alike_wherever_it_is_named(
    gauntlet: Command, swept: Path, calm: Path, grid: Path, command: str, arguments: list[str], cure: str
) -> None:
    places = {"swept": swept, "calm": calm, "grid": grid}
    answer = gauntlet(command, *(part.format(**places) for part in arguments))
    assert answer.code == 2
    assert cure.format(**places) in answer.err


@pytest.mark.parametrize(
    ("file", "command"),
    [
        ("results.parquet", "compare"),
        ("campaign.json", "compare"),
        ("results.parquet", "report"),
        ("topologies/variant-000.yaml", "report"),
    ],
)
def test_a_damaged_campaign_is_told_with_the_cure_and_no_traceback(
    gauntlet: Command, calm: Path, tmp_path: Path, file: str, command: str
) -> None:
    damaged = tmp_path / "damaged"
    shutil.copytree(calm, damaged)
    if file.startswith("topologies"):
        (damaged / file).unlink()
    else:
        (damaged / file).write_bytes((damaged / file).read_bytes()[:200])
    answer = gauntlet(command, damaged)
    assert answer.code == 2
    assert answer.err.startswith(f"gauntlet: {damaged}")
    assert "give its 'gauntlet sweep' again with another --out" in answer.err


def test_a_campaign_of_failed_trials_cannot_be_taken_apart_and_says_why(
    gauntlet: Command, tmp_path: Path
) -> None:
    (tmp_path / "failing.py").write_text("class Failing:\n    rounds = 0\n\n" + FAILING)
    (tmp_path / "small.yaml").write_text(SMALL)
    out = tmp_path / "out"
    failing = f"estimators.e1.method={tmp_path / 'failing.py'}:Failing"
    swept = gauntlet("sweep", tmp_path / "small.yaml", "--trials", 2, "--set", failing, "--out", out)
    assert swept.code == 3
    answer = gauntlet("compare", out, "--by", "node")
    assert answer.code == 2
    assert f"{out} cannot be taken apart by node: none of its trials was scored" in answer.err
