"""A table of numbers that grows and is cut at its end, without being copied each time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Rows:
    """Rows of equal length; the first column ascends."""

    def __init__(self, columns: int) -> None:
        self._store = np.empty((16, columns))
        self._first = np.empty(16)
        self.count = 0

    @property
    def all(self) -> Array:
        """The rows there are, shape (rows, columns); not to be kept over a change."""
        return self._store[: self.count]

    @property
    def first(self) -> Array:
        """The first column, in one piece for fast searches; not to be kept over a change."""
        return self._first[: self.count]

    def add(self, *row: float) -> None:
        """Add one row at the end."""
        if self.count == len(self._store):
            self._store = np.concatenate((self._store, np.empty_like(self._store)))
            self._first = np.concatenate((self._first, np.empty_like(self._first)))
        self._store[self.count] = row
        self._first[self.count] = row[0]
        self.count += 1

    def cut(self, count: int) -> None:
        """Forget all but the first `count` rows."""
        self.count = min(self.count, count)

    def at(self, values: Array) -> npt.NDArray[np.int64]:
        """Return the last row whose first column is at most each value; the first one at least."""
        found = self.first.searchsorted(values, side="right") - 1
        return np.asarray(np.maximum(found, 0))
