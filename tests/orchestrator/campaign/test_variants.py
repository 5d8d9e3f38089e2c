"""Variants that are named apart are different topologies, or the campaign is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from orchestrator.campaign.grid import GridError
from orchestrator.campaign.sweep import Request, prepare
from tests.orchestrator.campaign.conftest import SMALL


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            ("estimators.e1.detector=off,upper_bound", "estimators.*.detector=off"),
            "bound is the same topology",
        ),
        (("channel...failure=0.1,0.2", "channel=null"), "overrides channel...failure=0.2"),
        (("attacks.0.bias.value=1,1.0",), "both values mean the same"),
    ],
)
def test_settings_that_come_to_the_same_topology_are_refused(
    tmp_path: Path, overrides: tuple[str, ...], message: str
) -> None:
    (tmp_path / "small.yaml").write_text(SMALL)
    with pytest.raises(GridError, match=message):
        prepare(Request(tmp_path / "small.yaml", 2, overrides=overrides))


def test_other_seeds_and_the_twins_of_other_attacks_are_variants(tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text(SMALL)
    request = Request(
        tmp_path / "small.yaml", 2, overrides=("seed=1,2", "attacks.0.bias.value=1,2"), twins=True
    )
    assert len(prepare(request).variants) == 8
