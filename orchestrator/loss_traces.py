"""Recorded losses: from a text of 0 and 1 or from a run's log, and the channels that explain them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bus.messages import ChannelEvents
from channel.impairments.gilbert_elliott_fit import (
    GilbertElliottFit,
    GilbertFit,
    Losses,
    fit_gilbert,
    fit_gilbert_elliott,
)
from orchestrator.errors import InputError
from orchestrator.log.reader import read_log

_LOG = ".mcap"
_SEPARATORS = re.compile(r"[\s,;]+")


def read_losses(path: Path, link: str | None) -> Losses:
    """Return whether each slot was lost, from a text or from one link of a log; raises InputError."""
    if path.suffix == _LOG:
        return _losses_of_log(path, link)
    if link is not None:
        raise InputError(f"--link chooses a link of a run's {_LOG} file; {path} is none")
    return _losses_of_text(path)


def _losses_of_text(path: Path) -> Losses:
    """Read 0 and 1, separated by commas, blanks or lines; a first line of words is a heading."""
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read: {error}") from error
    losses: list[bool] = []
    for number, line in enumerate(lines, start=1):
        marks = [mark for mark in _SEPARATORS.split(line.partition("#")[0]) if mark]
        if not losses and any(mark[0].isalpha() for mark in marks):
            continue
        for mark in marks:
            if mark not in ("0", "1"):
                raise InputError(f"{path}:{number}: '{mark}' is not 0 (arrived) or 1 (lost)")
            losses.append(mark == "1")
    return np.array(losses, dtype=np.bool_)


def _losses_of_log(path: Path, link: str | None) -> Losses:
    """Return the fates of a link's slots in which something was sent."""
    losses: list[bool] = []
    links: set[str] = set()
    for topic, message in read_log(path).records():
        if not topic.startswith("channel/") or not isinstance(message, ChannelEvents):
            continue
        links.update(message.link)
        if link in message.link:
            place = message.link.index(link)
            if message.sent[place]:
                losses.append(message.lost[place] >= message.sent[place])
    if link is None or link not in links:
        listed = ", ".join(sorted(links)[:8]) + (", ..." if len(links) > 8 else "")
        what = "name one with --link" if link is None else f"there is no link '{link}'"
        raise InputError(f"{path}: {what}; there is: {listed}")
    return np.array(losses, dtype=np.bool_)


@dataclass(frozen=True)
class Fits:
    """The chains that were fitted; ``full`` is None where the losses do not tell its states apart."""

    slots: int
    lost: int
    simple: GilbertFit
    full: GilbertElliottFit | None

    def facts(self) -> dict[str, Any]:
        """Return all of it as plain data."""
        simple, full = self.simple, self.full
        return {
            "slots": self.slots,
            "lost": self.lost,
            "gilbert": {
                **simple.parameters,
                "failure_error": _finite(simple.failure_error),
                "recovery_error": _finite(simple.recovery_error),
                "log_likelihood": simple.log_likelihood,
            },
            "gilbert_elliott": None
            if full is None
            else {
                **full.parameters,
                "log_likelihood": full.log_likelihood,
                "iterations": full.iterations,
                "converged": full.converged,
            },
        }

    def lines(self) -> list[str]:
        """Return what to print: a ready line for each chain, with what is known about it."""
        simple, full = self.simple, self.full
        errors = f"+-{simple.failure_error:.2g}, +-{simple.recovery_error:.2g}"
        lines = [
            f"# {self.slots} slots, {self.lost} lost",
            f"gilbert_elliott: {_flow(simple.parameters)}   # {errors}; "
            f"log-likelihood {simple.log_likelihood:.1f}",
        ]
        if full is not None:
            state = "" if full.converged else ", not converged"
            told = f"log-likelihood {full.log_likelihood:.1f}{state}"
            lines.append(f"gilbert_elliott: {_flow(full.parameters)}   # {told}")
        return lines


def fits(losses: Losses) -> Fits:
    """Fit both chains; raises InputError where there is too little to fit."""
    try:
        simple = fit_gilbert(losses)
    except ValueError as error:
        raise InputError(str(error)) from error
    lost = int(losses.sum())
    full = fit_gilbert_elliott(losses) if 0 < lost < losses.size else None
    return Fits(losses.size, lost, simple, full)


def _finite(error: float) -> float | None:
    return error if np.isfinite(error) else None


def _flow(parameters: dict[str, float]) -> str:
    return "{" + ", ".join(f"{name}: {value:.4f}" for name, value in parameters.items()) + "}"
