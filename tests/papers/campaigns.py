"""How many trials the tests of a paper take."""

from __future__ import annotations

import pytest


def quick_or_full(quick: int, full: int) -> pytest.MarkDecorator:
    """Return the mark that gives a test its ``trials``: few always, and many with ``-m slow``."""
    return pytest.mark.parametrize(
        "trials",
        [
            pytest.param(quick, id="quick"),
            pytest.param(full, id="full", marks=[pytest.mark.slow, pytest.mark.timeout(3600)]),
        ],
    )
