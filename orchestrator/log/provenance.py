"""Where a log comes from: what was run, at which seed, with which versions; never when, where or by whom.

MCAP puts no check sum on metadata, and a log that was cut off has none over its data: the facts carry one.
"""

from __future__ import annotations

import platform
import subprocess
import zlib
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec

from bus.plan import Plan
from orchestrator.log.order import canonical_order

DISTRIBUTIONS = ("gauntlet", "eclipse-zenoh", "mcap", "msgspec", "networkx", "numpy", "scipy", "zstandard")
"""What every log and campaign notes the versions of."""
_GIT_TIMEOUT_S = 5.0
_SEAL = "crc32"
_CODE = Path(__file__).parents[2]


def sealed(facts: Mapping[str, str]) -> dict[str, str]:
    """Return the facts, sorted, with a check sum over them."""
    plain = dict(sorted(facts.items()))
    return {**plain, _SEAL: f"{zlib.crc32(msgspec.json.encode(plain)):08x}"}


def unsealed(facts: Mapping[str, str]) -> dict[str, str] | None:
    """Return sealed facts without their check sum, None when it does not fit them."""
    plain = {name: fact for name, fact in facts.items() if name != _SEAL}
    return plain if sealed(plain) == facts else None


def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return "none"


def git_commit(checkout: Path) -> str:
    """Return the commit of a checkout, given its uppermost folder; "none" when it is none."""
    command = ["git", "-C", str(checkout), "rev-parse", "--show-toplevel", "--verify", "HEAD"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=_GIT_TIMEOUT_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return "none"
    top, _, commit = answer.stdout.strip().partition("\n")
    return commit if answer.returncode == 0 and Path(top) == checkout.resolve() else "none"


def versions() -> dict[str, str]:
    """Return the versions of the code that runs, and the type of the machine.

    The commit is that of the code, if it runs from a checkout: a version like the others.
    """
    return {
        "git_commit": git_commit(_CODE),
        "machine": platform.machine(),
        "version.python": platform.python_version(),
        **{f"version.{name}": _version(name) for name in DISTRIBUTIONS},
    }


def provenance(plan: Plan, topology_hash: str) -> dict[str, str]:
    """Return the facts that the log's first record holds.

    The topology needs no commit, since its hash and all of its content are in the log.
    """
    return {
        "name": plan.name,
        "topology_hash": topology_hash,
        "seed": str(plan.seed),
        "trial": str(plan.trial),
        "steps": str(plan.steps),
        "period_s": repr(plan.period_s),
        "messages_per_step": str(len(canonical_order(plan))),
        **versions(),
    }
