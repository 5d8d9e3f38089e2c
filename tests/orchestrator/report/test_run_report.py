"""The page of a run says what the terminal says, in the same words."""

from __future__ import annotations

import io
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from orchestrator.report.contents import Mark, Page, Table, Tile
from orchestrator.report.making import page_for
from orchestrator.report.run_report import window_table
from orchestrator.report.run_tiles import run_tiles
from orchestrator.run import run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.score.link_results import Confusion, Lockout
from orchestrator.score.results import Score
from orchestrator.score.verdict import print_verdict
from orchestrator.topology.load import load_topology
from tests.playing import RING

UNDER_FIRE = (
    RING.format(name="under-fire", seed=7, steps=60)
    + """\
  lone: {method: kalman, sensors: [s1, s3]}
  judge: {method: kalman, sensors: [s1], threshold: 6.63}
attacks:
  - {injection: {count: 2, values: {near: {spread: 10}}}, on: s2->e2, steps: [20, 29]}
  - {bias: {value: 3.0}, on: s1->judge, steps: [30, 59]}
"""
)
FAILING = """
from nodes.estimators.kalman import Kalman

class Failing(Kalman):
    def correct(self, step, packets):
        raise ValueError("out of luck")
"""


APART = """
name: apart
steps: 60
period_s: 0.1
plant: {model: linear, A: [[0.9]], process_noise: {std: 0.1}, initial: {std: 1.0}}
sensors: {s1: {model: linear, C: [[1.0]], noise: {std: 0.1}}}
estimators:
  e1: {method: kalman, sensors: [s1]}
  e2: {method: kalman, sensors: [s1]}
  e3: {method: "./failing.py:Failing", sensors: [s1]}
"""


def run_and_report(home: Path, text: str) -> tuple[Page, Score]:
    """Run a topology and return its page and its score."""
    (home / "topology.yaml").write_text(text)
    topology = load_topology(home / "topology.yaml")
    directory = make_run_directory(home / "out", "run", 1)
    result = run_topology(topology, directory, "inprocess", lambda recorded: None)
    return page_for([directory]), result.score


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, Score]:
    return run_and_report(tmp_path_factory.mktemp("fire"), UNDER_FIRE)


@pytest.fixture(scope="module")
def partial(tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, Score]:
    """A run whose estimator e3 fails in its first step, so that no step is whole."""
    home = tmp_path_factory.mktemp("partial")
    (home / "failing.py").write_text(FAILING)
    return run_and_report(home, APART)


def table(page: Page, caption: str) -> Table:
    blocks = [block for section in page.sections for block in section.blocks]
    return next(own for own in blocks if isinstance(own, Table) and own.caption.startswith(caption))


def tile(tiles: list[Tile], name: str) -> Tile:
    return next(own for own in tiles if own.name == name)


def printed(score: Score) -> str:
    stream = io.StringIO()
    print_verdict(score, Console(file=stream, width=120))
    return stream.getvalue()


def words(cell: str | Mark) -> str:
    return cell.text if isinstance(cell, Mark) else cell


def test_packets_that_were_made_up_are_not_called_attacked(made: tuple[Page, Score]) -> None:
    page, score = made
    tiles = list(page.tiles)
    assert score.traffic.injected == 20
    assert (tile(tiles, "Packets injected").value, tile(tiles, "Packets injected").remark) == (
        "20",
        f"on 1 of {len(score.links)} links",
    )
    assert tile(tiles, "Packets attacked").value == f"{score.traffic.attacked}" == "30"
    alone = msgspec.structs.replace(score, traffic=msgspec.structs.replace(score.traffic, attacked=0))
    names = [own.name for own in run_tiles(alone)]
    assert "Packets injected" in names
    assert "Packets attacked" not in names


def test_each_attack_is_told_in_the_words_of_the_terminal(made: tuple[Page, Score]) -> None:
    page, score = made
    lines = [line.split() for line in printed(score).splitlines()]
    shown = table(page, "Attacks")
    assert list(shown.columns) == [
        *("attacked link", "by", "steps", "rejected", "false alarms", "alarm after", "trusted after")
    ]
    for row in shown.rows:
        cells = [words(cell).replace(" to ", "..") for cell in row]
        line = next(line for line in lines if line[:1] == [cells[0]])
        assert line == " ".join(cells).split()
    of_judge = next(row for row in shown.rows if row[0] == "s1->judge")
    assert of_judge[-1] == "-", "an attack that lasts to the end leaves no genuine packet to trust again"


def test_a_lucky_alarm_is_no_success(made: tuple[Page, Score]) -> None:
    _, score = made
    window = next(own for own in score.windows if own.judged)

    def mark(rejected: int, delay: int | None) -> str:
        own = msgspec.structs.replace(window, rejected=rejected, packets=299, delay=delay)
        row = window_table(msgspec.structs.replace(score, windows=[own]), []).rows[0]
        return next(cell.tone for cell in row if isinstance(cell, Mark))

    assert [mark(290, 0), mark(4, 19), mark(0, None)] == ["good", "warn", "bad"]


def test_the_share_of_false_alarms_alone_says_whether_it_is_warned_of(made: tuple[Page, Score]) -> None:
    _, score = made

    def tone(false_positive: int, lockouts: list[Lockout]) -> str:
        judged = Confusion.of(
            true_positive=0, false_positive=false_positive, false_negative=0, true_negative=1000
        )
        own = msgspec.structs.replace(score, detector=judged, lockouts=lockouts)
        return tile(run_tiles(own), "Genuine packets rejected").tone

    deaf = [Lockout(node="judge", link="s1->judge", first_step=5, packets=40)]
    assert [tone(170, []), tone(170, deaf), tone(30, []), tone(30, deaf)] == [
        "warn",
        "warn",
        "plain",
        "plain",
    ]
    locked = msgspec.structs.replace(score, lockouts=deaf)
    assert tile(run_tiles(locked), "Links locked out").tone == "warn"


def test_the_remarks_of_an_estimator_are_those_of_the_terminal(partial: tuple[Page, Score]) -> None:
    page, score = partial
    told = {row[0]: row[-1] for row in table(page, "Figures of each").rows}
    assert told["e3"] == "only 0 of 60 steps"
    assert told["e2"] == f"only {score.nodes[1].steps_scored} of 60 steps"
    assert told["e2"] in " ".join(printed(score).split())


def test_steps_that_one_node_kept_from_being_whole_are_counted_and_laid_on_it(
    partial: tuple[Page, Score],
) -> None:
    page, score = partial
    part = max(node.steps_scored for node in score.nodes)
    assert (score.steps_recorded, part > 0) == (0, True)
    assert page.headline.startswith(f"0 of 60 steps recorded whole and {part} in part for want of e3, ")
    shown = tile(list(page.tiles), "Steps recorded")
    assert (shown.value, shown.remark) == ("0 of 60", f"whole; {part} in part")
