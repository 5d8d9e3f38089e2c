"""Who errs least on a page: found among all groups, tested against all of them, claimed only when shown."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from orchestrator.campaign.sweep import Request, prepare, sweep
from orchestrator.command_line.campaign_output import QuietProgress
from orchestrator.evidence.chosen import choose
from orchestrator.evidence.columns import Rows
from orchestrator.report.best import find_best
from orchestrator.report.comparison import CONTENDERS, compared
from orchestrator.report.contents import Figure, Page, Table, Text
from orchestrator.report.grouping import find_groups
from orchestrator.report.groups import Group
from orchestrator.report.making import page_for

pytest.importorskip("plotly", reason="reports are an extra")
pytest.importorskip("jinja2", reason="reports are an extra")
pytest.importorskip("pyarrow", reason="campaigns are an extra")

TINY = """
name: tiny
steps: 20
period_s: 0.5
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
sensors: {s1: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}}
estimators: {e1: {method: kalman, sensors: [s1]}}
"""
STDS = ("3", "2.5", "2", "1.5", "1", "0.8", "0.6", "0.4", "0.2", "0.1")


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a campaign whose best variant is the last of ten."""
    home = tmp_path_factory.mktemp("many")
    (home / "tiny.yaml").write_text(TINY)
    overrides = (f"sensors.s1.noise.std={','.join(STDS)}",)
    return sweep(
        prepare(Request(home / "tiny.yaml", 12, overrides=overrides, out=home / "out")), QuietProgress()
    )


@pytest.fixture(scope="module")
def page(many: Path) -> Page:
    """The report of it."""
    return page_for([many])


def blocks(page: Page) -> list[object]:
    """Return what the page holds on comparisons."""
    return list(next(own.blocks for own in page.sections if own.title == "Comparison"))


def test_the_best_of_many_is_compared_with_all_of_them_wherever_it_stands(page: Page) -> None:
    assert "The smallest RMSE of position is that of std 0.1: " in page.headline
    assert page.headline.endswith("; it is shown to be better than every other.")
    first = blocks(page)[0]
    assert isinstance(first, Text)
    assert first.text == (
        "std 0.1 errs least in rmse.position. Tested against each of the 9 others, with p values adjusted "
        "among these tests alone, it is shown to be better every time."
    )


def test_those_that_err_least_are_compared_two_by_two_under_their_own_numbers(page: Page) -> None:
    table = next(own for own in blocks(page) if isinstance(own, Table))
    names = {name for row in table.rows for name in row[1:3]}
    assert names == {f"std {std}" for std in STDS[2:]}
    assert f"Of 10 groups the {CONTENDERS} that err least are compared two by two." in page.notes
    figure = next(own for own in blocks(page) if isinstance(own, Figure))
    assert figure.initial.layout["yaxis"]["ticktext"][0] == "3 less 4"
    assert figure.initial.layout["yaxis"]["ticktext"][-1] == "9 less 10"
    variants = next(own for own in page.sections[0].blocks if isinstance(own, Table))
    assert variants.rows[9][:2] == ("10", "std 0.1")


def with_errors(group: Group, errors: np.ndarray, number: int) -> Group:
    """Return a group whose trials have these errors."""
    held = group.rows.table
    column = held.column_names.index("rmse.position")
    table = held.set_column(column, "rmse.position", [errors])
    rows = Rows(table, group.rows.keys, group.rows.trial, group.rows.failed)
    return dataclasses.replace(group, rows=rows, name=f"g{number}", number=number)


def test_of_equals_one_is_called_the_best_as_rarely_as_a_test_of_two_is_wrong(many: Path) -> None:
    """A test at 5 % is wrong in 15 of 300: more than 29 come about less than once in a thousand times."""
    group = find_groups([choose(f"{many}#0")], None, [])[0]
    rng = np.random.default_rng(5)
    wrong = dict.fromkeys((2, 10), 0)
    for count in wrong:
        for _ in range(300 if count == 2 else 60):
            errors = rng.normal(5.0, 1.0, (count, 12))
            best = find_best([with_errors(group, own, i) for i, own in enumerate(errors, start=1)])
            assert best is not None
            wrong[count] += best.is_shown
    assert wrong[2] <= 29
    assert wrong[10] <= 3


def test_the_best_is_compared_two_by_two_even_where_trials_of_it_diverged(many: Path) -> None:
    group = find_groups([choose(f"{many}#0")], None, [])[0]
    errors = np.tile(np.linspace(1.0, 2.0, 12), (10, 1)) + np.arange(10)[::-1, None]
    errors[9, 0] = np.inf
    groups = [with_errors(group, own, i) for i, own in enumerate(errors, start=1)]
    groups = [dataclasses.replace(own, rank=(9 - i if i < 9 else 9)) for i, own in enumerate(groups)]
    best = find_best(groups)
    assert best is not None
    assert best.group.name == "g10", "its finite errors are the smallest"
    found = compared(groups, best.group, [])
    assert found is not None
    assert "g10" in [own.name for own in found.contenders]


def test_a_single_group_has_no_best(many: Path) -> None:
    page = page_for([f"{many}#0"])
    assert "smallest" not in page.headline
