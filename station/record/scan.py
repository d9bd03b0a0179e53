"""What is seen in a raw file: where its whole blocks stand, their order, and what is damaged.

A process numbers the blocks of a file from 0, and their times never fall. A block that was copied
over another holds by itself, but not among those around it.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field

NEVER = (math.inf, -math.inf)
"""The times of what belongs to no unit of work."""

DAMAGED_BLOCK = "a block's check sum or length does not hold"
DAMAGED_HEAD = "its first bytes are not those of a raw file"
DAMAGED_END = "its last bytes are not those of a raw file"
NAMELESS = "the block that names its unit of work is damaged"
MISPLACED = "a whole block stands where it was not written"
MISSING = "whole blocks are missing before this byte"
CUT = "it ends within a block"


@dataclass(frozen=True)
class Part:
    """A part of a file that cannot be believed, and the run times between which it was written.

    `units` are those that it says itself, and those of the whole blocks around it where that is
    not sure.
    """

    began: int
    length: int
    what: str
    from_s: float
    to_s: float
    units: tuple[str, ...] = ()


@dataclass
class Scan:
    """What a raw file holds: where the whole blocks of each unit of work stand, and what is bad."""

    places: dict[str, tuple[array[int], array[int]]] = field(default_factory=dict)
    """By unit where its blocks begin, and how long they are, in bytes."""
    parts: list[Part] = field(default_factory=list)
    size: int = 0
    whole_bytes: int = 0
    """Where the last whole block ends."""
    last_s: float = float("-inf")
    """The run time of the last whole block, in s."""
    sealed: bool = False
    """Whether the file was brought to its end by the process that wrote it."""
    sources: set[str] = field(default_factory=set)
    """The sources that its blocks say they are of."""

    def add(self, unit: str, began: int, length: int) -> None:
        """Add a whole block."""
        if unit not in self.places:
            self.places[unit] = (array("q"), array("q"))
        starts, lengths = self.places[unit]
        starts.append(began)
        lengths.append(length)
        self.whole_bytes = began + length

    def add_parts(self, parts: list[Part]) -> None:
        """Add damaged parts; those that follow each other nameless become one."""
        for part in parts:
            last = self.parts[-1] if self.parts else None
            if (
                last is not None
                and last.what == part.what == NAMELESS
                and last.began + last.length == part.began
            ):
                length = last.length + part.length
                units = tuple(dict.fromkeys((*last.units, *part.units)))
                self.parts[-1] = Part(last.began, length, NAMELESS, last.from_s, part.to_s, units)
            else:
                self.parts.append(part)


@dataclass
class BlockOrder:
    """Number and time of each whole block of a file, as they follow each other."""

    places: array[int] = field(default_factory=lambda: array("q"))
    numbers: array[int] = field(default_factory=lambda: array("q"))
    times_ns: array[int] = field(default_factory=lambda: array("q"))
    falls: bool = False

    def add(self, at: int, number: int, time_ns: int) -> None:
        """Add the next whole block."""
        if self.places:
            risen = number > self.numbers[-1] and time_ns >= self.times_ns[-1]
            self.falls = self.falls or not risen
        self.places.append(at)
        self.numbers.append(number)
        self.times_ns.append(time_ns)

    def misplaced(self) -> set[int]:
        """Return where the fewest blocks begin without which numbers rise and no time falls."""
        if not self.falls:
            return set()
        kept = rising(self.numbers, strictly=True)
        kept = [kept[k] for k in rising([self.times_ns[k] for k in kept], strictly=False)]
        return set(self.places).difference(self.places[k] for k in kept)


def rising(values: Sequence[int], *, strictly: bool) -> list[int]:
    """Return the places of a longest part of some values that rises, or does not fall."""
    ends: list[int] = []
    """Of a rising part by its length: the place of its last value, the smallest that there is."""
    lasts: list[int] = []
    before: list[int] = []
    for place, value in enumerate(values):
        length = (bisect_left if strictly else bisect_right)(lasts, value)
        before.append(ends[length - 1] if length else -1)
        if length == len(lasts):
            lasts.append(value)
            ends.append(place)
        elif value < lasts[length]:  # of two of the same number, the first
            lasts[length], ends[length] = value, place
    places, place = [], ends[-1] if ends else -1
    while place >= 0:
        places.append(place)
        place = before[place]
    return places[::-1]
