"""The columns of a linear model, given rows at a time: a long record has no matrix as a whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = slice | NDArray[np.int64]

BLOCK_ROWS = 2**16
"""Rows of a model that are in memory at once; a record with fewer is one block, made once."""


class Columns:
    """A model's columns, shape (rows, width), made a block of rows at a time by `make`."""

    def __init__(self, rows: int, make: Callable[[Rows], Array]) -> None:
        self.rows = rows
        self._make = make
        self._matrix = make(slice(0, rows)) if rows <= BLOCK_ROWS else None
        self.width = (make(slice(0, 1)) if self._matrix is None else self._matrix).shape[1]

    @classmethod
    def of(cls, matrix: Array) -> Columns:
        """Return a matrix that is there as columns."""
        return cls(len(matrix), lambda rows: matrix[rows])

    def blocks(self) -> Iterator[tuple[slice, Array]]:
        """Yield all rows in their order, each block with its place."""
        for first in range(0, self.rows, BLOCK_ROWS):
            place = slice(first, min(first + BLOCK_ROWS, self.rows))
            yield place, self.at(place)

    def at(self, rows: Rows) -> Array:
        """Return some rows."""
        return self._make(rows) if self._matrix is None else self._matrix[rows]

    def where(self, mask: NDArray[np.bool_]) -> Columns:
        """Return the rows that a mask (rows,) marks."""
        places = np.flatnonzero(mask)
        return Columns(len(places), lambda rows: self.at(places[rows]))

    def first(self, width: int) -> Columns:
        """Return the first `width` columns."""
        return Columns(self.rows, lambda rows: self.at(rows)[:, :width])

    def times(self, coefficients: Array) -> Array:
        """Return X b for columns X, shape (rows,)."""
        return np.concatenate([combine(block, coefficients) for _, block in self.blocks()])


def combine(columns: Array, coefficients: Array) -> Array:
    """Return X b for columns X (n, k), by one core: see `linear.cross_products`."""
    return np.asarray(np.einsum("ij,j->i", columns, coefficients))
