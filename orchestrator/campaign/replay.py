"""One trial of a campaign alone: which topology it has, and whether it came out as the campaign says."""

from __future__ import annotations

from pathlib import Path

from orchestrator.campaign.directory import CampaignError, read_facts
from orchestrator.evidence.rows import FAILED
from orchestrator.evidence.sources import RESULTS, load_source, topology_file
from orchestrator.evidence.table import SWEPT
from orchestrator.score.repetition import shown

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


def compared(directory: Path, variant: int, trial: int, run: Path) -> str:
    """Return a sentence on how the score of a run compares with the rows of the trial that it repeats."""
    import pyarrow.compute as pc

    if not (directory / RESULTS).is_file():
        return "the campaign is unfinished: its results cannot be compared yet"
    held = load_source(directory).table
    of_trial = pc.and_(pc.equal(held["variant"], variant), pc.equal(held["trial"], trial))
    rows = held.filter(of_trial)
    if not rows.num_rows:
        return f"the campaign holds no trial {trial}; there is nothing to compare with"
    if rows["status"][0].as_py() == FAILED:
        return f"in the campaign, this trial failed: {rows['message'][0].as_py()}"
    own = load_source(run).table
    names = [name for name in own.column_names if name not in _OF_THE_CAMPAIGN and not name.startswith(SWEPT)]
    differing = [name for name in names if own[name].combine_chunks() != rows[name].combine_chunks()]
    if differing:
        told = shown(differing)
        return f"the score is NOT that of the campaign ({told}): are the versions and the machine the same?"
    return "the score is that of the campaign's row, bit for bit"
