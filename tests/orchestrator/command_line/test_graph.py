"""`gauntlet graph`: the network as a picture."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.orchestrator.command_line.conftest import Command

pytest.importorskip("matplotlib", reason="drawing is an extra")


@pytest.mark.parametrize(
    ("name", "begin"),
    [("a.svg", b"<?xml"), ("a.png", b"\x89PNG\r\n"), ("a.pdf", b"%PDF-"), ("a.SVG", b"<?xml")],
)
def test_the_ending_chooses_the_kind_of_picture(
    gauntlet: Command, home: Path, name: str, begin: bytes
) -> None:
    answer = gauntlet("graph", "small.yaml", "--out", name)
    assert (answer.code, answer.out, answer.err) == (0, f"wrote {name}\n", "")
    assert (home / name).read_bytes().startswith(begin)


def test_without_a_name_the_picture_is_network_svg_and_shows_every_node(
    gauntlet: Command, home: Path
) -> None:
    assert gauntlet("graph", "small.yaml").code == 0
    picture = (home / "network.svg").read_text()
    for name in ("plant", "s1", "s2", "s3", "e1", "e2", "e3", "small"):
        assert f"<!-- {name} -->" in picture


@pytest.mark.parametrize(
    ("out", "complaint"),
    [
        ("a.gif", "a.gif: the ending '.gif' is not .svg, .png or .pdf"),
        ("picture", "picture: the ending '' is not .svg, .png or .pdf"),
        ("nowhere/a.svg", "nowhere/a.svg cannot be written: No such file or directory"),
    ],
)
def test_a_picture_that_cannot_be_written_is_bad_input(
    gauntlet: Command, home: Path, out: str, complaint: str
) -> None:
    answer = gauntlet("graph", "small.yaml", "--out", out)
    assert answer.code == 2
    assert complaint in answer.err
    assert not (home / out).exists()


def test_a_bad_topology_is_told_as_by_validate(gauntlet: Command) -> None:
    answer = gauntlet("graph", "small.yaml", "--set", "steps=0")
    assert answer.code == 2
    assert "steps" in answer.err
