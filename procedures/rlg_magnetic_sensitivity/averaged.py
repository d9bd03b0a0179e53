"""A record that is longer than the analysis takes at once: means over groups of samples.

The mean of d means over successive intervals is the mean over d intervals: what the instrument
itself would have given at d times its sample interval, counted pulses included. Wild samples are
set aside before, since no mean survives them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.linear import least_squares, reject_outliers
from procedures.estimation.noise import grid_index
from procedures.estimation.sine import LineSums, legendre_columns, line_columns, nearest_lines

from .dataset import Array, Averaged, Mask, Segment
from .field import stretch_of_field
from .frequencies import Drive, group_size
from .parameters import AnalysisSettings

Index = NDArray[np.int64]
Model = Callable[[Index], Array]
Judge = Callable[[Index, Array], tuple[Mask, Model]]

FEWEST_OF_GROUP = 0.5
GYRO_STRETCH, FIELD_STRETCH = 2**14, 2**13
FEWEST_CYCLES = 10.0
"""Of the slowest drive in a stretch: fewer would be taken for drift."""


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


@dataclass
class Counted:
    """What is counted of a record while its samples pass, the published lines summed up."""

    interval_s: float
    lines: Mapping[str, LineSums]
    samples: int = 0
    gaps: int = 0
    longest_gap_s: float = 0.0
    first: int = 0
    last: int = field(default=-1)

    def passing(self, pieces: Iterable[tuple[Index, Array]]) -> Iterator[tuple[Index, Array]]:
        """Pass places (n,) and rates (n,) on, as columns."""
        for place, rate in pieces:
            if not len(place):
                continue
            if self.samples == 0:
                self.first, self.last = int(place[0]), int(place[0]) - 1
            steps = np.diff(place, prepend=self.last)
            self.gaps += int((steps > 1).sum())
            self.longest_gap_s = max(self.longest_gap_s, float(steps.max()) * self.interval_s)
            self.samples += len(place)
            self.last = int(place[-1])
            for line in self.lines.values():
                line.add(rate)
            yield place, rate[:, None]

    @property
    def places(self) -> int:
        """The samples that the record would have without gaps."""
        return self.last - self.first + 1

    def amplitude_deg_per_h(self) -> dict[str, float | None]:
        """Return what the published formula reads by axis; it needs an unbroken row."""
        unbroken = self.samples == self.places
        return {axis: line.peak() if unbroken else None for axis, line in self.lines.items()}


@dataclass(frozen=True)
class GyroMeans:
    """Means of groups of a gyro's samples: middles on the grid (m,), rates (m,), what was there."""

    place: Array
    rate_deg_per_h: Array
    rejected: int
    counted: Counted


def averaged_gyro(
    pieces: Iterable[tuple[Index, Array]],
    samples: int,
    group: int,
    interval_s: float,
    quantum_deg_per_h: float,
    drive: Mapping[str, Drive],
) -> GyroMeans:
    """Return the means over groups of a gyro's `samples`, wild ones set aside as the fit does it.

    `pieces` are places on the grid (n,) and rates (n,), in their order. Each stretch is held
    against drift and the driven lines for itself.
    """
    settings = AnalysisSettings()
    frequencies = [driven.frequency_Hz for driven in drive.values()]
    lines = {
        axis: LineSums(samples, nearest_lines(samples, interval_s, driven.frequency_Hz))
        for axis, driven in drive.items()
    }
    counted = Counted(interval_s, lines)

    def judge(place: Index, rate: Array) -> tuple[Mask, Model]:
        start_s, stop_s = float(place[0]) * interval_s, float(place[-1]) * interval_s
        mean = float(np.median(rate))

        def columns(at: Index) -> Array:
            time_s = np.asarray(at * interval_s, dtype=np.float64)
            drift = legendre_columns(time_s, settings.max_drift_order, start_s, stop_s)
            return np.hstack((drift, line_columns(time_s, frequencies)))

        design = columns(place)
        if len(place) < 4 * design.shape[1]:
            return np.ones(len(place), dtype=bool), lambda at: np.full((len(at), 1), mean)
        data = rate[:, 0] - mean
        quantum = quantum_deg_per_h
        kept = reject_outliers(design, data, settings.outlier, 0.6 * quantum, quantum)
        coefficients = least_squares(design[kept], data[kept]).coefficients
        return kept, lambda at: (columns(at) @ coefficients + mean)[:, None]

    rows = stretch_rows(GYRO_STRETCH, frequencies, interval_s)
    means = group_means(counted.passing(pieces), group, rows, judge)
    return GyroMeans(means.place, means.value[:, 0], means.rejected, counted)


def averaged(means: GyroMeans, group: int, rejected_field_rows: int) -> Averaged:
    """Return what a record was before it was averaged."""
    counted = means.counted
    return Averaged(
        group=group,
        sample_interval_s=counted.interval_s,
        samples=counted.samples,
        places=counted.places,
        rejected=means.rejected,
        gaps=counted.gaps,
        longest_gap_s=counted.longest_gap_s,
        rejected_field_rows=rejected_field_rows,
        amplitude_deg_per_h=counted.amplitude_deg_per_h(),
    )


def averaged_field(
    pieces: Iterable[tuple[Array, Array]],
    group: int,
    step_s: float,
    drive: Mapping[str, Drive],
) -> tuple[Array, Array, int]:
    """Return times (m,) and field (m, 3) of groups of readings, and how many were wild.

    `pieces` are times (n,) and fields (n, 3) in mT, in their order; readings are about `step_s`
    apart.
    """
    began_s: float | None = None
    last_place, last_s = 0, 0.0
    driven = {axis: driven for axis, driven in drive.items() if driven.amplitude_mT > 0.0}

    def on_grid() -> Iterator[tuple[Index, Array]]:
        nonlocal began_s, last_place, last_s
        for time_s, field_mT in pieces:
            if not len(time_s):
                continue
            if began_s is None:
                began_s, last_s = float(time_s[0]), float(time_s[0]) - step_s
                last_place = -1
            steps = np.maximum(np.rint(np.diff(time_s, prepend=last_s) / step_s), 1.0)
            place = last_place + np.cumsum(steps).astype(np.int64)
            last_place, last_s = int(place[-1]), float(time_s[-1])
            yield place, np.column_stack((time_s - began_s - place * step_s, field_mT))

    def judge(place: Index, value: Array) -> tuple[Mask, Model]:
        kept, model = stretch_of_field(driven, value[:, 0] + place * step_s, value[:, 1:])
        middle = 0.5 * float(place[0] + place[-1])
        late_s = value[kept, 0]
        away = place[kept] - middle
        power = float(away @ away)
        slope = float(away @ (late_s - late_s.mean())) / power if power > 0.0 else 0.0
        mean_s = float(late_s.mean()) - slope * float(away.mean())

        def at(places: Index) -> Array:
            late = mean_s + slope * (places - middle)
            return np.column_stack((late, model(late + places * step_s)))

        return kept, at

    slowest = [line.frequency_Hz for line in driven.values()]
    means = group_means(on_grid(), group, stretch_rows(FIELD_STRETCH, slowest, step_s), judge)
    if not len(means.place):
        return np.empty(0), np.empty((0, 3)), means.rejected
    time_s = means.value[:, 0] + means.place * step_s + (began_s or 0.0)
    return time_s, means.value[:, 1:], means.rejected


def shortened(segment: Segment) -> Segment:
    """Return a segment that is in memory, averaged where it is too long for its analysis."""
    highest_Hz = max(driven.frequency_Hz for driven in segment.drive.values())
    group = group_size(len(segment.time_s), segment.sample_interval_s, highest_Hz)
    return segment if group == 1 else in_groups(segment, group)


def in_groups(segment: Segment, group: int) -> Segment:
    """Return a segment's means over groups of samples."""
    interval_s, samples = segment.sample_interval_s, len(segment.time_s)
    place = grid_index(segment.time_s, interval_s)
    means = averaged_gyro(
        [(place, segment.rate_deg_per_h)],
        samples,
        group,
        interval_s,
        segment.quantum_deg_per_h,
        segment.drive,
    )
    step_s = float(np.median(np.diff(segment.field_time_s)))
    readings = [(segment.field_time_s, segment.field_mT)]
    field_time_s, field_mT, rejected = averaged_field(readings, group, step_s, segment.drive)
    return replace(
        segment,
        sample_interval_s=group * interval_s,
        time_s=np.interp(means.place, place, segment.time_s),
        rate_deg_per_h=means.rate_deg_per_h,
        quantum_deg_per_h=segment.quantum_deg_per_h / group,
        field_time_s=field_time_s,
        field_mT=field_mT,
        field_averaging_s=averaged_duration_s(segment.field_averaging_s, step_s, group),
        averaged=averaged(means, group, rejected),
    )


def stretch_rows(least: int, frequencies_Hz: Iterable[float], interval_s: float) -> int:
    """Return the rows of a stretch: some whole cycles of the slowest drive."""
    slowest_Hz = min((f for f in frequencies_Hz if f > 0.0), default=0.0)
    cycles = round(FEWEST_CYCLES / slowest_Hz / interval_s) if slowest_Hz else 0
    return max(least, cycles)
