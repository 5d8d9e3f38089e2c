"""Where a run writes: a directory of its own, never another run's."""

from __future__ import annotations

from pathlib import Path

from orchestrator.errors import InputError

LOG = "run.mcap"
SCORE = "score.json"
TIMING = "timing.json"
TOPOLOGY = "topology.yaml"
NODE_LOGS = "nodes"

_MOST_RUNS = 100_000


class RunDirectoryError(InputError):
    """The directory cannot be used; the message tells the cure."""


def log_in(path: Path) -> Path:
    """Return the log that a path leads to: the file itself, or the log in the directory of a run.

    Raises `RunDirectoryError` for a directory without one.
    """
    if not path.is_dir():
        return path
    if not (path / LOG).is_file():
        raise RunDirectoryError(f"{path} holds no {LOG}; give a log, or the directory of a run")
    return path / LOG


def make_run_directory(
    out: Path | None, name: str, seed: int, parent: Path = Path("runs"), option: str = "--out"
) -> Path:
    """Make and return the directory of a new run, with its folder for the nodes' logs.

    Without ``out`` it is the first free ``<parent>/<name>-seed<seed>-<n>``. ``option`` is what the user
    chooses the place with, for the text of errors. Raises `RunDirectoryError` when ``out`` holds a run
    already or cannot be written.
    """
    try:
        directory = _first_free(parent, f"{name}-seed{seed}", option) if out is None else _chosen(out)
        (directory / NODE_LOGS).mkdir(exist_ok=True)
    except OSError as error:
        raise RunDirectoryError(f"{error.filename}: {error.strerror}; choose another {option}") from error
    return directory


def _chosen(out: Path) -> Path:
    if (out / LOG).exists():
        raise RunDirectoryError(f"{out} holds a run already; remove it or choose another --out")
    if out.exists() and not out.is_dir():
        raise RunDirectoryError(f"{out} is a file; choose a directory as --out")
    out.mkdir(parents=True, exist_ok=True)
    return out


def _first_free(parent: Path, stem: str, option: str) -> Path:
    parent.mkdir(parents=True, exist_ok=True)
    for number in range(1, _MOST_RUNS):
        directory = parent / f"{stem}-{number}"
        try:
            directory.mkdir()
        except FileExistsError:
            continue
        return directory
    raise RunDirectoryError(
        f"{parent} holds {_MOST_RUNS} runs of {stem}; remove some or choose another {option}"
    )
