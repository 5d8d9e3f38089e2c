"""How many false packets there are in a slot, and what they say: the laws that attacks share.

A law draws from the generator of one slot, so that what it draws depends on nothing that was drawn before.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Annotated, Protocol

import numpy as np
from annotated_types import Ge

from bus.packets import Packet, Vector
from channel.attacks.falsifying import FalsifyingLane
from channel.contract import Ledger, Slot

Size = Annotated[int, Ge(1)]
Numbers = float | list[float]
Natural = Annotated[int, Ge(0)]
Deviation = Annotated[float, Ge(0.0)]


@dataclass(frozen=True)
class CountLaw:
    """How many packets: exactly one of a ``fixed`` number, ``uniform`` on [low, high], ``poisson`` (mean)."""

    fixed: Natural | None = None
    uniform: list[int] | None = None
    poisson: Annotated[float, Ge(0.0)] | None = None

    def __post_init__(self) -> None:
        """Refuse what is no law; raises ValueError."""
        if sum(law is not None for law in (self.fixed, self.uniform, self.poisson)) != 1:
            raise ValueError("a count has exactly one of 'fixed', 'uniform' and 'poisson'")
        if self.uniform is not None and (
            len(self.uniform) != 2 or not 0 <= self.uniform[0] <= self.uniform[1]
        ):
            raise ValueError(f"'uniform' {self.uniform} must be [low, high] with 0 <= low <= high")

    def draw(self, generator: np.random.Generator) -> int:
        """Draw a number of packets."""
        if self.fixed is not None:
            return self.fixed
        if self.uniform is not None:
            low, high = self.uniform
            return int(generator.integers(low, high, endpoint=True))
        return int(generator.poisson(self.poisson or 0.0))


def count_law(count: int | CountLaw) -> CountLaw:
    """Return the law of a count that may be a plain number."""
    return CountLaw(fixed=count) if isinstance(count, int) else count


class Seen:
    """What an adversary has seen pass on a link: the newest payload, and ``memory`` older ones."""

    def __init__(self, memory: int) -> None:
        self.older: deque[Vector] = deque(maxlen=memory)

    def note(self, packets: Sequence[Packet]) -> None:
        """Take the packets of a slot."""
        self.older.extend(packet.values for packet in packets)

    @property
    def newest(self) -> Vector | None:
        """The newest payload, None before the first."""
        return self.older[-1] if self.older else None


class _Law(Protocol):
    def draw(
        self, generator: np.random.Generator, count: int, genuine: Vector | None, older: Sequence[Vector]
    ) -> list[Vector] | None: ...


def _size(size: int | None, genuine: Vector | None, **bounds: Numbers) -> int | None:
    """Return the size of a payload; raises ValueError when a law states another than genuine packets have."""
    listed = {len(bound) for bound in bounds.values() if isinstance(bound, list)}
    stated = size if size is not None else next(iter(listed), None)
    if size is None and genuine is not None and stated not in (None, genuine.size):
        raise ValueError(
            f"a law of {stated} values for a payload of {genuine.size}; give {genuine.size}, or state a "
            "'size' to send malformed packets"
        )
    return stated if stated is not None or genuine is None else genuine.size


def _check_sizes(size: int | None, **bounds: Numbers) -> None:
    listed = {len(bound) for bound in bounds.values() if isinstance(bound, list)}
    if len(listed | ({size} if size is not None and listed else set())) > 1:
        names = " and ".join(f"'{name}'" for name in bounds)
        raise ValueError(f"{names} must have one length, that of 'size' if there is one")


@dataclass(frozen=True)
class Box:
    """Uniform between ``low`` and ``high``, each one number or one for each component of the payload.

    ``size`` is that of the payload. Without it a list tells it, or else the packets that were seen.
    """

    low: Numbers
    high: Numbers
    size: Size | None = None

    def __post_init__(self) -> None:
        """Refuse what is no box; raises ValueError."""
        _check_sizes(self.size, low=self.low, high=self.high)
        if np.any(np.asarray(self.low) > np.asarray(self.high)):
            raise ValueError(f"'low' {self.low} is above 'high' {self.high}; exchange them")

    def draw(
        self, generator: np.random.Generator, count: int, genuine: Vector | None, older: Sequence[Vector]
    ) -> list[Vector] | None:
        """Draw payloads; None while their size is unknown."""
        size = _size(self.size, genuine, low=self.low, high=self.high)
        if size is None:
            return None
        low, high = np.asarray(self.low, dtype=np.float64), np.asarray(self.high, dtype=np.float64)
        return list(low + (high - low) * generator.random((count, size)))


@dataclass(frozen=True)
class Normal:
    """Gaussian and independent over components, with ``mean`` and ``std`` of one number or one each.

    ``size`` as for a box.
    """

    std: Deviation | list[Deviation]
    mean: Numbers = 0.0
    size: Size | None = None

    def __post_init__(self) -> None:
        """Refuse what is no Gaussian law; raises ValueError."""
        _check_sizes(self.size, std=self.std, mean=self.mean)
        if np.any(np.asarray(self.std) < 0.0):
            raise ValueError(f"'std' {self.std} must not be negative")

    def draw(
        self, generator: np.random.Generator, count: int, genuine: Vector | None, older: Sequence[Vector]
    ) -> list[Vector] | None:
        """Draw payloads; None while their size is unknown."""
        size = _size(self.size, genuine, std=self.std, mean=self.mean)
        if size is None:
            return None
        std, mean = np.asarray(self.std, dtype=np.float64), np.asarray(self.mean, dtype=np.float64)
        return list(mean + std * generator.standard_normal((count, size)))


@dataclass(frozen=True)
class Near:
    """Uniform in a box of half-width ``spread`` around the genuine payload, or the newest that was seen."""

    spread: Numbers

    def __post_init__(self) -> None:
        """Refuse what is no half-width; raises ValueError."""
        if np.any(np.asarray(self.spread) < 0.0):
            raise ValueError(f"'spread' {self.spread} must not be negative")

    def draw(
        self, generator: np.random.Generator, count: int, genuine: Vector | None, older: Sequence[Vector]
    ) -> list[Vector] | None:
        """Draw payloads; None while nothing was seen."""
        if genuine is None:
            return None
        _size(None, genuine, spread=self.spread)
        spread = np.asarray(self.spread, dtype=np.float64)
        return list(genuine + spread * (2.0 * generator.random((count, genuine.size)) - 1.0))


@dataclass(frozen=True)
class Copied:
    """The payload of a packet of an earlier slot: any of the last ``memory`` ones, with equal chances."""

    memory: Size = 100

    def draw(
        self, generator: np.random.Generator, count: int, genuine: Vector | None, older: Sequence[Vector]
    ) -> list[Vector] | None:
        """Draw payloads; None while nothing was seen."""
        if not older:
            return None
        return [older[int(draw * len(older))] for draw in generator.random(count)]


@dataclass(frozen=True)
class ValueLaw:
    """What false packets say: exactly one of ``box``, ``normal``, ``near`` and ``copied``."""

    box: Box | None = None
    normal: Normal | None = None
    near: Near | None = None
    copied: Copied | None = None

    def __post_init__(self) -> None:
        """Refuse what is no law; raises ValueError."""
        if sum(getattr(self, field.name) is not None for field in fields(self)) != 1:
            listed = ", ".join(field.name for field in fields(self))
            raise ValueError(f"values follow exactly one law of {listed}")

    @property
    def memory(self) -> int:
        """How many older packets it needs."""
        return 1 if self.copied is None else self.copied.memory

    def draw(
        self, generator: np.random.Generator, count: int, genuine: Vector | None, older: Sequence[Vector]
    ) -> list[Vector] | None:
        """Draw the payloads of a number of packets, None when what they follow was not yet seen.

        ``genuine`` is the payload beside which they stand, and ``older`` holds those of earlier slots, the
        newest last.
        """
        laws: tuple[_Law | None, ...] = (self.box, self.normal, self.near, self.copied)
        law = next(law for law in laws if law is not None)
        return law.draw(generator, count, genuine, older)


class DrawnLane(FalsifyingLane):
    """A falsifying lane whose values follow a law, with a generator of its own for each slot."""

    cure = "give one number, or one for each attacked component"
    may_resize = True
    generator: np.random.Generator
    law: ValueLaw
    seen: Seen

    def rest(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Watch what passes."""
        self.seen.note(packets)
        return packets

    def false(self, slot: Slot, values: Vector) -> Vector | None:
        """Return a draw for the attacked part of a payload."""
        index = self.part.index
        older = [payload[index] for payload in self.seen.older] if self.law.copied else ()
        drawn = self.law.draw(self.generator, 1, values, older)
        return None if drawn is None else drawn[0]
