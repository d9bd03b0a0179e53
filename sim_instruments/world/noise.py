"""White noise that belongs to time itself: the same whoever looks, how often and in which order."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sim_instruments.world.averaging import lengths_of

Array = npt.NDArray[np.float64]

CELL_S = 1e-3
BLOCK = 1024


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
        self._key = rng.integers(0, 2**63, size=2).astype(np.uint64)

    def mean(self, edges_s: Array) -> Array:
        """Return the mean between neighbouring times, shape (intervals,)."""
        if self._step == 0.0:
            return np.zeros(edges_s.size - 1)
        cells = edges_s / self._cell_s
        first = int(np.floor(cells[0] / BLOCK))
        last = int(np.floor(cells[-1] / BLOCK))
        steps = self._step * np.concatenate([self._block(k) for k in range(first, last + 1)])
        walk = np.concatenate(([0.0], np.cumsum(steps)))
        at = np.interp(cells - first * BLOCK, np.arange(walk.size), walk)
        return np.asarray(np.diff(at) / lengths_of(edges_s))

    def _block(self, number: int) -> Array:
        counter = np.array([0, 0, 0, number % 2**64], dtype=np.uint64)
        rng = np.random.Generator(np.random.Philox(key=self._key, counter=counter))
        return rng.standard_normal(BLOCK)
