"""Functions of time in pieces: means over intervals by quadrature, and a table that grows."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


Indices = npt.NDArray[np.int64]

LONG_AGO_S = -1e6
"""Before anything happens."""


class Nodes(NamedTuple):
    """Times at which to evaluate, the interval each belongs to, and its weight there."""

    time_s: Array
    owner: Indices
    weight: Array
    intervals: int

    def mean(self, values: Array) -> Array:
        """Return the means of values given at the times, shape (times, …), by interval."""
        result = np.zeros((self.intervals, *values.shape[1:]))
        weight = self.weight.reshape(-1, *[1] * (values.ndim - 1))
        np.add.at(result, self.owner, weight * values)
        return result


@lru_cache
def gauss(order: int) -> tuple[Array, Array]:
    """Return Gauss's nodes between -1 and 1 and their weights."""
    points, weights = np.polynomial.legendre.leggauss(order)
    return points, weights


def nodes_within(starts_s: Array, ends_s: Array, longest_s: float, order: int) -> Nodes:
    """Return `order` nodes in each of the equal panels, at most `longest_s` long, of intervals.

    Exact for polynomials up to the degree 2 order - 1 within a panel.
    """
    length = ends_s - starts_s
    panels = np.maximum(np.ceil(length / longest_s), 1.0).astype(np.int64)
    owner = np.repeat(np.arange(starts_s.size), panels)
    number = np.arange(owner.size) - np.repeat(np.cumsum(panels) - panels, panels)
    width = (length / panels)[owner]
    points, weights = gauss(order)
    begin = starts_s[owner] + number * width
    times = begin[:, None] + width[:, None] * (0.5 + 0.5 * points)
    share = np.broadcast_to(0.5 * weights, times.shape) / panels[owner][:, None]
    return Nodes(times.ravel(), np.repeat(owner, order), share.ravel(), starts_s.size)


def lengths_of(edges_s: Array) -> Array:
    """Return the lengths of the intervals between neighbouring times, 1 s for empty ones.

    A meter that reads without a pause asks for the empty ones between its readings, too: what is
    integrated over them is 0, and so is then the mean.
    """
    lengths_s = np.diff(edges_s)
    return np.where(lengths_s > 0.0, lengths_s, 1.0)


class Pieces:
    """Intervals cut where something changes, so that everything is smooth within a piece."""

    def __init__(self, edges_s: Array, kinks_s: Sequence[Array]) -> None:
        inside = [times[(times > edges_s[0]) & (times < edges_s[-1])] for times in kinks_s]
        self.edges_s: Array = np.unique(np.concatenate([edges_s, *inside]))
        self.starts_s, self.ends_s = self.edges_s[:-1], self.edges_s[1:]
        self.middles_s = 0.5 * (self.starts_s + self.ends_s)
        self._lengths_s = lengths_of(edges_s)
        self._owner = np.searchsorted(edges_s, self.middles_s, side="right") - 1

    def together(self, means: Array) -> Array:
        """Return the means by interval of means by piece, shape (pieces, …)."""
        result = np.zeros((self._lengths_s.size, *means.shape[1:]))
        columns = [1] * (means.ndim - 1)
        share = (self.ends_s - self.starts_s) / self._lengths_s[self._owner]
        np.add.at(result, self._owner, share.reshape(-1, *columns) * means)
        return result


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
        rows = self.first.searchsorted(values, side="right") - 1
        return np.asarray(np.maximum(rows, 0))
