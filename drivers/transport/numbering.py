"""From sequence numbers of a few bits to numbers that go on, whatever is lost."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

LATE_BY = 32
"""A frame that is at most so many behind the newest comes late, or twice."""

Numbers = NDArray[np.int64]
Kept = NDArray[np.bool_]
Counting = Callable[[NDArray[np.uint8], NDArray[np.float64]], tuple[Numbers, Kept]]


class Numbering:
    """Number frames from 1, whose own number goes from 0 to `modulus` - 1 and begins again.

    What a gap of `modulus` frames and more swallowed is told by when the next ones came. Arrivals
    are late by chance, never early: only a delay that none of a block's later frames makes up for
    is a gap.
    """

    def __init__(self, interval_s: float, modulus: int) -> None:
        self._interval_s = interval_s
        self._modulus = modulus
        self._sequence: int | None = None
        self._number = 0
        self._expected_s = 0.0
        """When the last number was due, by the least late of the last block."""

    def numbers(
        self, sequence: NDArray[np.uint8], arrival_s: NDArray[np.float64]
    ) -> tuple[Numbers, Kept]:
        """Return the frames' numbers, and which of them are new, shape (frames,) each."""
        if not len(sequence):
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_)
        if self._sequence is None:
            self._sequence = (int(sequence[0]) - 1) % self._modulus
            self._expected_s = float(arrival_s[0]) - self._interval_s
        steps, kept = self._steps(sequence)
        number = self._number + np.cumsum(steps)
        expected_s = self._expected_s + (number - self._number) * self._interval_s
        late_s = (arrival_s - expected_s)[kept]
        lost = np.zeros(len(sequence), dtype=np.int64)
        if len(late_s):
            surely_s = np.minimum.accumulate(late_s[::-1])[::-1]
            around_s = self._modulus * self._interval_s
            rounds = np.floor(np.maximum(surely_s, 0.0) / around_s + 0.5).astype(np.int64)
            lost[kept] = self._modulus * np.maximum.accumulate(rounds)
            lost = np.maximum.accumulate(lost)
            least_s = float(np.min(late_s - lost[kept] * self._interval_s))
            gone = int(number[-1] + lost[-1]) - self._number
            self._expected_s += gone * self._interval_s + least_s
            number = number + lost
            self._number += gone
            self._sequence = int(sequence[kept][-1])
        return number, kept

    def looked_at(
        self, sequence: NDArray[np.uint8], arrival_s: NDArray[np.float64]
    ) -> tuple[Numbers, Kept]:
        """Return no numbers for frames that somebody will take later."""
        return np.zeros(len(sequence), dtype=np.int64), np.ones(len(sequence), dtype=np.bool_)

    def _steps(self, sequence: NDArray[np.uint8]) -> tuple[Numbers, Kept]:
        """Return by how many each frame is after the newest one before it; 0 for one left out."""
        assert self._sequence is not None
        before = np.concatenate(([self._sequence], sequence[:-1].astype(np.int64)))
        steps = (sequence.astype(np.int64) - before) % self._modulus
        kept = np.ones(len(sequence), dtype=np.bool_)
        if bool(((steps == 0) | (steps >= self._modulus - LATE_BY)).any()):
            newest = self._sequence
            for k, one in enumerate(sequence.tolist()):
                step = (one - newest) % self._modulus
                kept[k] = 0 < step < self._modulus - LATE_BY
                steps[k] = step if kept[k] else 0
                newest = one if kept[k] else newest
        return steps, kept
