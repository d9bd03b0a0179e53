"""A record that is too long for the memory, made shorter: means over groups of samples.

The mean of d means over successive intervals is the mean over d intervals: what the instrument
itself would have given at d times its sample interval, counted pulses included. Wild samples are
set aside before, since no mean survives them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Model = Callable[[Index], Array]
Judge = Callable[[Index, Array], tuple[Mask, Model]]

FEWEST_OF_GROUP = 0.5


def averaged_duration_s(averaging_s: float, step_s: float, group: int) -> float:
    """Return the averaging time of the mean of a group of readings `step_s` apart.

    Exact where one averaging follows the other; else to the fourth order of a line's cycles in it.
    """
    return math.sqrt(averaging_s**2 + (group**2 - 1) * step_s**2)


@dataclass(frozen=True)
class Means:
    """The means of groups: where their middles are on the grid (m,), values (m, k), rejected rows.

    A group that lost up to half of its samples is completed by the model of its stretch.
    """

    place: Array
    value: Array
    rejected: int


def group_means(
    rows: Iterable[tuple[Index, Array]], group: int, stretch_rows: int, judge: Judge
) -> Means:
    """Return the means over groups of `group` places of a grid.

    `rows` gives places (n,), ascending, and values (n, k), piece by piece; `judge` says of each
    stretch, of `stretch_rows` and more, which rows are not wild and what its model is.
    """
    places: list[Array] = []
    values: list[Array] = []
    rejected = 0
    for place, value in stretches(rows, group, stretch_rows):
        kept, model = judge(place, value)
        rejected += int((~kept).sum())
        where, mean = means_of_stretch(place[kept], value[kept], group, model)
        places.append(where)
        values.append(mean)
    if not places:
        return Means(np.empty(0), np.empty((0, 1)), 0)
    return Means(np.concatenate(places), np.concatenate(values), rejected)


def means_of_stretch(place: Index, value: Array, group: int, model: Model) -> tuple[Array, Array]:
    """Return the middles (m,) and the means (m, k) of the groups of one stretch."""
    if not len(place):
        return np.empty(0), np.empty((0, value.shape[1]))
    number = place // group
    first = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
    count = np.diff(np.append(first, len(number)))
    mean = np.add.reduceat(value, first, axis=0) / count[:, None]
    numbers = number[first]
    part = np.flatnonzero(count < group)
    if len(part):
        own = np.add.reduceat(model(place), first, axis=0)[part] / count[part, None]
        whole = numbers[part][:, None] * group + np.arange(group)
        all_of_it = model(whole.ravel()).reshape(*whole.shape, -1).mean(axis=1)
        mean[part] += all_of_it - own
    enough = count >= FEWEST_OF_GROUP * group
    middle = np.asarray(numbers * float(group) + 0.5 * (group - 1), dtype=np.float64)
    return middle[enough], mean[enough]


def stretches(
    rows: Iterable[tuple[Index, Array]], group: int, stretch_rows: int
) -> Iterator[tuple[Index, Array]]:
    """Yield rows in stretches of `stretch_rows` to twice as many, cut between two groups."""
    place, value = np.empty(0, dtype=np.int64), np.empty((0, 1))
    for more_places, more in rows:
        place = np.concatenate((place, more_places))
        value = np.concatenate((value.reshape(-1, more.shape[1]), more))
        first = 0
        while len(place) - first >= 2 * max(stretch_rows, group):
            border = place[first + max(stretch_rows, group)] // group * group
            last = int(np.searchsorted(place, border))
            yield place[first:last], value[first:last]
            first = last
        place, value = place[first:], value[first:]
    if len(place):
        yield place, value
