"""`gauntlet fit`: from recorded losses to a line of a topology."""

from __future__ import annotations

from pathlib import Path

import pytest
from ruamel.yaml import YAML

from bus.messages import ChannelEvents
from orchestrator.log.reader import read_log
from tests.orchestrator.command_line.conftest import Command

TRACE = "lost\n" + "0\n0\n1\n1\n0,0 0\n1\n0 # the end\n"


def test_a_trace_gives_lines_that_a_topology_understands(gauntlet: Command, home: Path) -> None:
    (home / "losses.csv").write_text(TRACE)
    answer = gauntlet("fit", "losses.csv")
    assert answer.code == 0
    assert answer.out.startswith("# 9 slots, 3 lost\n")
    simple, full = (YAML(typ="safe").load(line)["gilbert_elliott"] for line in answer.out.splitlines()[1:])
    assert simple == {"failure": 0.4, "recovery": 0.6667}
    assert set(full) == {"failure", "recovery", "loss_good", "loss_bad"}


def test_the_fit_is_json_for_programs(gauntlet: Command, home: Path) -> None:
    (home / "losses.csv").write_text("0 0 0 0")
    facts = gauntlet("fit", "losses.csv", "--json").json()
    assert (facts["slots"], facts["lost"], facts["gilbert_elliott"]) == (4, 0, None)
    assert facts["gilbert"]["failure"] == 0.0
    assert facts["gilbert"]["recovery_error"] is None


def test_a_links_losses_are_read_from_a_log(gauntlet: Command, finished_run: Path) -> None:
    log = finished_run / "run.mcap"
    events = [m for topic, m in read_log(log).records() if isinstance(m, ChannelEvents)]
    link = events[-1].link[0]
    mine = [event for event in events if link in event.link]
    facts = gauntlet("fit", log, "--link", link, "--json").json()
    assert facts["slots"] == len(mine)
    assert facts["lost"] == sum(event.lost[event.link.index(link)] for event in mine)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("0\n2\n", "losses.csv:2: '2' is not 0"),
        ("1", "at least two slots"),
        ("0\nlost\n", "losses.csv:2: 'lost'"),
    ],
)
def test_what_is_no_trace_is_told_by_its_line(
    gauntlet: Command, home: Path, text: str, complaint: str
) -> None:
    (home / "losses.csv").write_text(text)
    answer = gauntlet("fit", "losses.csv")
    assert answer.code == 2
    assert complaint in answer.err


def test_a_link_that_is_not_there_is_told_with_those_that_are(gauntlet: Command, finished_run: Path) -> None:
    answer = gauntlet("fit", finished_run / "run.mcap", "--link", "x->y")
    assert answer.code == 2
    assert "there is no link 'x->y'; there is: " in answer.err
    assert "name one with --link" in gauntlet("fit", finished_run / "run.mcap").err
