"""Other readings of a dataset: columns, signs, units and labels that mean something else.

A procedure declares each mix-up that laboratories make as a `Reading`: what was meant, and the data
read so. All are held against the data as stated by what a model leaves of each, in one test. A
reading suits only if it leaves no more than noise does, or, where the noise is not known, a small
part of what the stated one leaves; and if data that disagree for any other cause would come so near
to one of all readings of its kind by a small chance. A misfit in f degrees of freedom has a random
direction: one of n readings leaves the part p of its squares with a chance of about n p^(f/2).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from station.findings import CONTRADICTS, Flag

Array = NDArray[np.float64]
Data = TypeVar("Data")

BY_CHANCE = 0.05
"""So seldom one of the readings of a kind may suit data that disagree for another cause."""
BETTER = 0.1
"""Of the rms that the stated reading leaves: as much may a reading leave where noise is unknown."""
MAX_NAMED = 4
"""Where more readings than these suit, the data tell none of them from the others."""
DEG_PER_H = {"deg/s": 3600.0, "deg/min": 60.0, "rad/s": 3600.0 * 180.0 / np.pi, "mdeg/s": 3.6}
"""Units that a rate stated in deg/h may be in; arcsec/s is deg/h."""


@dataclass(frozen=True)
class Reading(Generic[Data]):
    """What was meant, as it ends "if …", and the data read so.

    `apply` gives None where the mix-up is impossible. `statement` names the column or condition,
    `details` go into the flag. `code` is one of docs/reference/flags.md.
    """

    what: str
    apply: Callable[[Data], Data | None]
    statement: str
    details: Mapping[str, Any] = field(default_factory=dict)
    code: str = CONTRADICTS

    def flag(self, message: str, axis: str | None = None, **details: object) -> Flag:
        """Return the flag of this reading in a procedure's sentence."""
        stated = {"statement": self.statement} if self.code == CONTRADICTS else {}
        return Flag(self.code, message, axis, {**stated, **self.details, **details})


@dataclass(frozen=True)
class Remainder:
    """What a model leaves of a reading: the squares and their degrees of freedom.

    `noise` is the largest sum of squares that noise makes, in the unit of `squares`; 0 where the
    noise is not known.
    """

    squares: float
    freedom: float
    noise: float = 0.0


@dataclass(frozen=True)
class Suit(Generic[Data]):
    """A reading that suits the data: what it leaves, and its chance among all that were tried."""

    reading: Reading[Data]
    data: Data
    squares: float
    chance: float


def suiting(
    data: Data,
    kinds: Iterable[Sequence[Reading[Data]]],
    remainder: Callable[[Data], Remainder | None],
    *,
    stated: Remainder | None = None,
    better: float = BETTER,
) -> list[Suit[Data]]:
    """Return the readings that suit data which disagree as stated, the best one first.

    The readings of a kind share the chance `BY_CHANCE`. `better` is the part of the rms that one
    may leave where the noise is unknown. `remainder` gives None for data without a
    solution. Empty where none suits, and where more than `MAX_NAMED` do.
    """
    stated = stated or remainder(data)
    if stated is None or stated.squares <= stated.noise:
        return []
    suits = []
    for kind in kinds:
        readings = [(reading, reading.apply(data)) for reading in kind]
        tried = [(reading, other) for reading, other in readings if other is not None]
        for reading, other in tried:
            rest = remainder(other)
            if rest is None or rest.squares > (rest.noise or better**2 * stated.squares):
                continue
            part = max(rest.squares, rest.noise) / stated.squares
            chance = len(tried) * part ** (0.5 * rest.freedom)
            if chance < BY_CHANCE:
                suits.append(Suit(reading, other, rest.squares, chance))
    suits.sort(key=lambda suit: suit.squares)
    if not stated.noise:
        # What is no better than the stated reading beside the best one is none, either.
        suits = [suit for suit in suits if BETTER**2 * suit.squares <= suits[0].squares]
    return suits if len(suits) <= MAX_NAMED else []


def named(suits: Sequence[Suit[Any]]) -> str:
    """Return the readings as a sentence names them: "a, or if b"."""
    return ", or if ".join(suit.reading.what for suit in suits)


def scaled(names: Sequence[str], factor: float) -> Callable[[Any], Any]:
    """Return how arrays of a dataset are read in another unit, or with the other sign."""
    return lambda data: replace(data, **{name: factor * getattr(data, name) for name in names})


def exchanged(first: str, second: str) -> Callable[[Any], Any]:
    """Return how two arrays of a dataset are read under each other's names."""

    def apply(data: Any) -> Any:
        return replace(data, **{first: getattr(data, second), second: getattr(data, first)})

    return apply


def shifted(names: Sequence[str], rows: int) -> Callable[[Any], Any]:
    """Return how arrays that stand `rows` rows late are read, the last reading repeated."""

    def apply(data: Any) -> Any:
        count = len(getattr(data, names[0]))
        place = np.clip(np.arange(count) + rows, 0, count - 1)
        return replace(data, **{name: getattr(data, name)[place] for name in names})

    return apply


def units(
    column: str, names: Sequence[str], factors: Mapping[str, float]
) -> Iterator[Reading[Any]]:
    """Yield the readings of a column in other units, `factors` to the stated one."""
    for unit, factor in factors.items():
        yield Reading(f"{column} is in {unit}", scaled(names, factor), column, {"unit": unit})
