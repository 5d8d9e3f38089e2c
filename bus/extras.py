"""How to install what only some uses need: the extras of this project."""

from __future__ import annotations


def installing(extra: str) -> str:
    """Return the words that tell how to install an extra.

    They lead to a checkout: the project's name on the public index belongs to another project.
    """
    return f"pip install -e '.[{extra}]' in a checkout of Gauntlet"
