"""One trial of a campaign with its log, for what only a single run shows."""

from __future__ import annotations

from pathlib import Path

from orchestrator.campaign.replay import topology_of_trial
from orchestrator.reproduction.claims import Trial
from orchestrator.reproduction.errors import ReproduceError
from orchestrator.run_directory import LOG


def directory_of(campaign: Path, trial: Trial) -> Path:
    """Return where the run of a trial is kept: inside its campaign."""
    return campaign / "replays" / f"variant-{trial.variant}-trial-{trial.trial}"


def run_again(campaign: Path, trial: Trial) -> Path:
    """Return the log of a trial's run, made unless it is there; raises `ReproduceError` if it fails."""
    from orchestrator.run import run_topology
    from orchestrator.topology.load import load_topology

    topology = load_topology(topology_of_trial(campaign, trial.variant), [f"trial={trial.trial}"])
    directory = directory_of(campaign, trial)
    log = directory / LOG
    if log.is_file() and _holds(log, topology.hash):
        return log
    log.unlink(missing_ok=True)
    directory.mkdir(parents=True, exist_ok=True)
    report = run_topology(topology, directory, "inprocess", lambda _: None)
    if report.message:
        raise ReproduceError(f"{directory}: the run of trial {trial.trial} failed: {report.message}")
    return log


def _holds(log: Path, topology_hash: str) -> bool:
    """Return whether a log is the whole record of a topology."""
    from orchestrator.log.errors import LogError
    from orchestrator.log.reader import read_log

    try:
        found = read_log(log)
    except LogError:
        return False
    return found.complete and found.provenance.get("topology_hash") == topology_hash
