"""Noise that belongs to time itself: the same whoever looks, how often and in which order.

It is drawn in blocks, each from its own counter of one generator; what nobody looks at costs
nothing, and in a random walk one draw per block.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from sim_instruments.world.piecewise import Array, lengths_of

BLOCK = 1024
BLOCKS_KEPT = 8

CELL_S = 1e-3
INSTANT_S = 1e-5


class Blocks:
    """Normal numbers of variance one in blocks of a shape, each drawn from its own counter."""

    def __init__(self, rng: np.random.Generator, *shape: int) -> None:
        self._key = rng.integers(0, 2**63, size=2).astype(np.uint64)
        self._shape = shape
        self._kept: dict[int, Array] = {}

    def block(self, number: int) -> Array:
        """Return the numbers of one block."""
        if number not in self._kept:
            if len(self._kept) >= BLOCKS_KEPT:
                self._kept.clear()
            counter = np.array([0, 0, 0, number % 2**64], dtype=np.uint64)
            rng = np.random.Generator(np.random.Philox(key=self._key, counter=counter))
            self._kept[number] = rng.standard_normal(self._shape)
        return self._kept[number]


class WhiteNoise:
    """Noise whose mean over T has the standard deviation `in_one_second` / sqrt(T / 1 s).

    White up to half the frequency of its cells: the mean over less than one is no noisier than over
    it.
    """

    def __init__(
        self, in_one_second: float, rng: np.random.Generator, cell_s: float = CELL_S
    ) -> None:
        self._cell_s = cell_s
        self._step = in_one_second * np.sqrt(cell_s)
        self._blocks = Blocks(rng, BLOCK)

    def mean(self, edges_s: Array) -> Array:
        """Return the mean between neighbouring times, shape (intervals,)."""
        if self._step == 0.0:
            return np.zeros(edges_s.size - 1)
        cells = edges_s / self._cell_s
        first = int(np.floor(cells[0] / BLOCK))
        last = int(np.floor(cells[-1] / BLOCK))
        steps = self._step * np.concatenate([self._blocks.block(k) for k in range(first, last + 1)])
        walk = np.concatenate(([0.0], np.cumsum(steps)))
        at = np.interp(cells - first * BLOCK, np.arange(walk.size), walk)
        return np.asarray(np.diff(at) / lengths_of(edges_s))


class InstantNoise:
    """White noise of samples: one value in each 10 us, white up to 50 kHz."""

    def __init__(self, deviation: float, rng: np.random.Generator) -> None:
        self._deviation = deviation
        self._blocks = Blocks(rng, BLOCK)

    def at(self, time_s: Array) -> Array:
        """Return the noise at each time, same shape."""
        if self._deviation == 0.0 or time_s.size == 0:
            return np.zeros(time_s.shape)
        cells = np.floor(time_s / INSTANT_S).astype(np.int64)
        numbers, block = np.unique(cells // BLOCK, return_inverse=True)
        draws = np.stack([self._blocks.block(k) for k in numbers.tolist()])
        return np.asarray(self._deviation * draws[block.reshape(cells.shape), cells % BLOCK])


def within(cells: npt.NDArray[np.int64]) -> Iterator[tuple[int, slice | npt.NDArray[np.bool_]]]:
    """Yield the number of each block that cells lie in, and which of them do."""
    if not cells.size:
        return
    first, last = int(cells.min()) // BLOCK, int(cells.max()) // BLOCK
    if first == last:
        yield first, slice(None)
        return
    blocks = cells // BLOCK
    for number in np.unique(blocks).tolist():
        yield number, blocks == number


class Normals(Blocks):
    """Independent normal numbers of variance one, a row for each cell of time."""

    def __init__(self, columns: int, cell_s: float, rng: np.random.Generator) -> None:
        super().__init__(rng, BLOCK, columns)
        self.columns, self.cell_s = columns, cell_s

    def rows(self, cells: npt.NDArray[np.int64]) -> Array:
        """Return the rows of cells, shape (cells, columns)."""
        result = np.empty((cells.size, self.columns))
        for number, here in within(cells):
            result[here] = self.block(number)[cells[here] - number * BLOCK]
        return result


class ReadingNoise:
    """Noise of readings: new in every cell, `sigma` (one for each column) in size."""

    def __init__(self, sigma: Array, cell_s: float, rng: np.random.Generator) -> None:
        self._sigma = sigma
        self._normals = Normals(sigma.size, cell_s, rng)

    def at(self, time_s: Array) -> Array:
        """Return the noise at each time, shape (times, columns)."""
        cells = np.floor(time_s / self._normals.cell_s).astype(np.int64)
        return self._sigma * self._normals.rows(cells)


class Wander:
    """A smooth, stationary error of `sigma`, forgotten after about one cell."""

    def __init__(self, sigma: Array, cell_s: float, rng: np.random.Generator) -> None:
        self._sigma = sigma
        self._normals = Normals(sigma.size, cell_s, rng)

    def at(self, time_s: Array) -> Array:
        """Return the error at each time, shape (times, columns)."""
        place = time_s / self._normals.cell_s
        cells = np.floor(place).astype(np.int64)
        # Squares of sine and cosine add to one: as large between two cells as in them.
        turn = 0.5 * np.pi * (place - cells)[:, None]
        here, there = self._normals.rows(cells), self._normals.rows(cells + 1)
        return np.asarray(self._sigma * (np.cos(turn) * here + np.sin(turn) * there))


class RandomWalk:
    """A walk from zero at 0 s; its variance grows by the square of `step` (by column) a second.

    White up to half the frequency of the cells, between which it goes straight.
    """

    def __init__(self, step: Array, cell_s: float, rng: np.random.Generator) -> None:
        self._step = step * np.sqrt(cell_s)
        self._normals = Normals(step.size, cell_s, rng)
        self._starts = [np.zeros(step.size)]
        self._kept: dict[int, Array] = {}

    def at(self, time_s: Array) -> Array:
        """Return where the walk is at each time, shape (times, columns); at rest before 0 s."""
        place = np.maximum(time_s, 0.0) / self._normals.cell_s
        cells = np.floor(place).astype(np.int64)
        part = (place - cells)[:, None]
        result = np.empty((time_s.size, self._step.size))
        for number, here in within(cells):
            walk, inside = self._block(number), cells[here] - number * BLOCK
            begin = walk[inside]
            result[here] = begin + part[here] * (walk[inside + 1] - begin)
        return result

    def _block(self, number: int) -> Array:
        """Return the walk at the edges of a block's cells, shape (BLOCK + 1, columns)."""
        while len(self._starts) <= number:
            gained = self._step * self._normals.block(len(self._starts) - 1).sum(axis=0)
            self._starts.append(self._starts[-1] + gained)
        if number not in self._kept:
            if len(self._kept) >= BLOCKS_KEPT:
                self._kept.clear()
            steps = self._step * self._normals.block(number)
            walk = np.concatenate((np.zeros((1, self._step.size)), np.cumsum(steps, axis=0)))
            self._kept[number] = self._starts[number] + walk
        return self._kept[number]


def generator(seed: int, name: str) -> np.random.Generator:
    """Return the generator of the device `name` on a bench with this `seed`.

    The name enters by its SHA-256, since Python's own hash changes from process to process.
    """
    words = np.frombuffer(hashlib.sha256(name.encode("utf-8")).digest(), dtype="<u4")
    return np.random.default_rng(np.random.SeedSequence([seed, *(int(word) for word in words)]))
