"""One trial of a campaign alone: which topology it has, and whether it came out as the campaign says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orchestrator import exit_codes
from orchestrator.campaign.directory import CampaignError, read_facts
from orchestrator.campaign.user_code import changed_code, code_of
from orchestrator.evidence.rows import FAILED
from orchestrator.evidence.sources import RESULTS, load_source, topology_file
from orchestrator.evidence.table import SWEPT
from orchestrator.score.repetition import shown

if TYPE_CHECKING:
    from orchestrator.topology.resolved import Topology

_OF_THE_CAMPAIGN = ("variant", "message")
_MOST_REPLAYS = 1000


def topology_of_trial(directory: Path, variant: int) -> Path:
    """Return the file of a variant's topology; raises `CampaignError` when there is none."""
    facts = read_facts(directory)
    if facts is None:
        raise CampaignError(f"{directory} holds no campaign; give the --out of a 'gauntlet sweep'")
    count = len(facts["variants"])
    if variant >= count:
        raise CampaignError(f"{directory} has no variant {variant}; its variants are 0 to {count - 1}")
    return topology_file(directory, variant)


def directory_of_replay(directory: Path, variant: int, trial: int) -> Path:
    """Return the first free directory for a replay of a trial."""
    stem = directory / "replays" / f"variant-{variant}-trial-{trial}"
    names = (stem.with_name(f"{stem.name}-{number}") for number in range(1, _MOST_REPLAYS))
    return next(name for name in names if not name.exists())


@dataclass(frozen=True)
class Comparison:
    """How a repeated trial compares with its row in the campaign.

    Parameters
    ----------
    message
        A sentence for people.
    is_same
        Whether the score is that of the row, bit for bit; None when there is no score to compare with.
    changed
        What is not as it was when the campaign was made: code of a user's own by name, or the topology.
    """

    message: str
    is_same: bool | None = None
    changed: tuple[str, ...] = ()

    @property
    def exit_code(self) -> int:
        """What a run that went to its end is worth: bad input, or a score that should be another."""
        if self.changed:
            return exit_codes.BAD_INPUT
        return exit_codes.EXPECTATION_FAILED if self.is_same is False else exit_codes.PASSED

    def facts(self) -> dict[str, Any]:
        """Return the whole as plain data, ready for JSON."""
        return {"same_score": self.is_same, "changed": self.changed, "message": self.message}


def compared(directory: Path, variant: int, topology: Topology, run: Path) -> Comparison:
    """Return how the score of a run compares with the rows of the trial that it repeats.

    Parameters
    ----------
    directory
        That of the campaign.
    variant
        The variant's number.
    topology
        What was run, at the trial.
    run
        The directory of the run.
    """
    changed = _changed(directory, variant, topology)
    message, is_same = _of_rows(directory, variant, topology.plan.trial, run)
    if changed:
        message = f"{' and '.join(changed)} changed since the campaign was made; {message}"
    elif is_same is False:
        message += ": are the versions and the machine the same?"
    return Comparison(message, is_same, tuple(changed))


def _changed(directory: Path, variant: int, topology: Topology) -> list[str]:
    """Return what of a topology is not as the campaign had it: its code, and else the topology itself."""
    facts = read_facts(directory)
    assert facts is not None
    found = code_of([topology.plan])
    names = changed_code(facts["code"], found) if "code" in facts else []
    if names:
        return [f"the code of {name}" for name in names]
    as_held = topology.at(trial=facts["first_trial"]).hash
    return [] if as_held == facts["topology_hashes"][variant] else ["the topology or a class in it"]


def _of_rows(directory: Path, variant: int, trial: int, run: Path) -> tuple[str, bool | None]:
    """Return a sentence on the score beside that of the campaign's rows, and whether it is the same."""
    import pyarrow.compute as pc

    if not (directory / RESULTS).is_file():
        return "the campaign is unfinished: its results cannot be compared yet", None
    held = load_source(directory).table
    of_trial = pc.and_(pc.equal(held["variant"], variant), pc.equal(held["trial"], trial))
    rows = held.filter(of_trial)
    if not rows.num_rows:
        return f"the campaign holds no trial {trial}; there is nothing to compare with", None
    if rows["status"][0].as_py() == FAILED:
        return f"in the campaign, this trial failed: {rows['message'][0].as_py()}", None
    own = load_source(run).table
    names = [name for name in own.column_names if name not in _OF_THE_CAMPAIGN and not name.startswith(SWEPT)]
    differing = [name for name in names if own[name].combine_chunks() != rows[name].combine_chunks()]
    if differing:
        return f"the score is NOT that of the campaign ({shown(differing)})", False
    return "the score is that of the campaign's row, bit for bit", True
