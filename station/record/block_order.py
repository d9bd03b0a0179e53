"""Whether the whole blocks of a raw file follow each other as they were written.

A process numbers the blocks of a file from 0, and their times never fall. A block that was copied
over another holds by itself, but not among those around it.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field


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
    found, place = [], ends[-1] if ends else -1
    while place >= 0:
        found.append(place)
        place = before[place]
    return found[::-1]
