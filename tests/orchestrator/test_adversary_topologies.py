"""The small topologies of the attacks, one a kind: each runs, and holds what it expects of itself."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from orchestrator.registry import BUILT_IN
from orchestrator.score.results import Score
from orchestrator.score.verdict import print_verdict
from orchestrator.topology.load import load_topology
from tests.playing import scored

FOLDER = Path(__file__).parents[2] / "topologies" / "adversary"
KINDS = sorted(path.stem for path in FOLDER.glob("[a-z]*.yaml") if path.stem in BUILT_IN["attacks"])


def played(name: str, *overrides: str) -> Score:
    return scored(load_topology(FOLDER / f"{name}.yaml", list(overrides)))


@pytest.mark.parametrize("kind", KINDS)
def test_a_topology_of_an_attack_holds_what_it_expects(kind: str) -> None:
    result = played(kind)
    assert [outcome.message for outcome in result.expectations if not outcome.passed] == []
    assert len(result.expectations) > 2
    assert result.passed


@pytest.mark.parametrize("kind", KINDS)
def test_its_expectations_fail_without_the_attack(kind: str) -> None:
    assert not played(kind, "attacks=null").passed


def test_with_the_keys_sybil_packets_pass() -> None:
    packets = played("sybil", "adversary={knows: [keys]}", "expect=null").traffic
    assert (packets.injected, packets.refused) == (20, 0)


def test_a_replay_with_old_headers_gives_itself_away() -> None:
    result = played("replay", "attacks[0].replay.rewrite=false", "expect=null")
    assert result.traffic.attacked == 20
    assert not result.lockouts


def test_the_verdict_mentions_injected_and_refused_packets_only_where_there_are_some() -> None:
    def packet_line(kind: str) -> str:
        console = Console(width=200, record=True, file=io.StringIO())
        print_verdict(played(kind), console)
        (line,) = [line for line in console.export_text().splitlines() if line.startswith("Packets:")]
        return line

    assert packet_line("sybil").endswith("0 attacked, 20 injected, 20 refused, 1300 delivered.")
    assert packet_line("bias").endswith("6 attacked, 1300 delivered.")
