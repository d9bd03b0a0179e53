"""What the calibration of a nine-axis sensor needs, without samples that measured nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.frozen import (
    IN_A_ROW,
    equal_runs,
    repeated_windows,
)
from procedures.estimation.saturation import stands_at_top

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

AXES = ("X", "Y", "Z")
AT_THE_END = 1.0 - 1e-6
MAX_OF_A_RECORD = 0.01
MOSTLY = 0.9
ALWAYS_NEW = 0.9
"""Of coarse data, of which fewer differ from the one before, none counts as frozen."""


@dataclass(frozen=True)
class Prior:
    """What is known of the set-up beforehand, as standard uncertainties.

    `heading_rad` is common to all positions, `relative_heading_rad` and `tilt_rad` (of each of the
    two horizontal axes) are each position's own. `misalignment_rad` is that of a gyro's input axis
    towards another one where the rates did not measure it. `mounting_rad` is how far a sensor axis
    that should lie along the table's leans from it, about each of two axes, as it was mounted;
    `table_axes_rad` is what the table's axes add to that.
    """

    heading_rad: float
    relative_heading_rad: float
    tilt_rad: float
    accelerometer_bias_g: float
    misalignment_rad: float = 0.0
    mounting_rad: float = 0.0
    table_axes_rad: float = 0.0


@dataclass(frozen=True)
class StaticRecord:
    """One position at rest: `time_s` (n,) rises, the other two have shape (n, 3), axes X Y Z.

    `position` is one of `positions.ATTITUDES`. `time_s` is the end of each sample's interval.
    """

    position: int
    time_s: Array
    rate_deg_per_h: Array
    acceleration_g: Array


@dataclass(frozen=True)
class TurnRecord:
    """One axis at one rate in one sense, spin-up and settling dropped.

    The turned axis (0, 1, 2 for X, Y, Z) points up; rates and angles are positive counter-clockwise
    seen from above. `rate_deg_per_s` (n, 3) holds NaN for gyros that were not recorded.
    `encoder_deg` (n,) is the table's encoder at `time_s`, the end of each sample's interval,
    continuous or modulo 360; NaN where it was not read. `encoder_u_deg` is the standard uncertainty
    of the angle at each end that its scatter does not show: NaN where the scatter shows it.
    """

    axis: int
    commanded_deg_per_s: float
    time_s: Array
    rate_deg_per_s: Array
    encoder_deg: Array
    encoder_u_deg: float = np.nan


@dataclass(frozen=True)
class NineAxisDataset:
    """All that was recorded; `largest_rate_deg_per_s` is where the gyro saturates, if known."""

    latitude_deg: float
    prior: Prior
    static: tuple[StaticRecord, ...]
    turns: tuple[TurnRecord, ...]
    largest_rate_deg_per_s: float | None = None


@dataclass(frozen=True)
class Saturated:
    """Saturated samples of one turned axis at one rate; `whole` when the record is left out."""

    axis: int
    commanded_deg_per_s: float
    count: int
    whole: bool


def without_saturated(
    dataset: NineAxisDataset,
) -> tuple[NineAxisDataset, tuple[Saturated, ...], int]:
    """Return the dataset without saturated samples, which ones those were, and how many at rest.

    A record of which more than a hundredth is saturated is left out: what is cut off at one end
    makes the mean of the others wrong. Where the range is not known, output that stands still at
    its largest value, and does not at slower rates, counts as saturated.
    """
    range_deg_per_s = dataset.largest_rate_deg_per_s
    saturated: list[Saturated] = []
    turns = []
    for record in dataset.turns:
        rate = record.rate_deg_per_s
        own = rate[:, record.axis]
        over = _beyond(rate, range_deg_per_s)
        if not bool(over[:, record.axis].any()) and _stands_still(own, record, dataset.turns):
            over[:, record.axis] = True
        count = int(over[:, record.axis].sum())
        if bool(over.any()):
            whole = over.mean(axis=0) > MAX_OF_A_RECORD
            over[:, whole] = True
            record = replace(record, rate_deg_per_s=np.where(over, np.nan, rate))
            if count:
                saturated.append(
                    Saturated(
                        record.axis, record.commanded_deg_per_s, count, bool(whole[record.axis])
                    )
                )
        turns.append(record)
    static, at_rest = [], 0
    for still in dataset.static:
        over = _beyond(still.rate_deg_per_h / 3600.0, range_deg_per_s)
        at_rest += int(over.sum())
        if bool(over.any()):
            still = replace(still, rate_deg_per_h=np.where(over, np.nan, still.rate_deg_per_h))
        static.append(still)
    return replace(dataset, static=tuple(static), turns=tuple(turns)), tuple(saturated), at_rest


def _beyond(rate: Array, range_deg_per_s: float | None) -> Mask:
    if range_deg_per_s is None:
        return np.zeros(rate.shape, dtype=bool)
    return np.asarray(np.abs(rate) >= AT_THE_END * range_deg_per_s)


def _stands_still(own: Array, record: TurnRecord, turns: Sequence[TurnRecord]) -> bool:
    """Return whether output stands at its largest value as it never does at slower rates."""
    slower = [
        turn.rate_deg_per_s[:, turn.axis]
        for turn in turns
        if turn.axis == record.axis
        and abs(turn.commanded_deg_per_s) < abs(record.commanded_deg_per_s)
        and np.isfinite(turn.rate_deg_per_s[:, turn.axis]).any()
    ]
    return stands_at_top(own, slower)


def without_frozen(dataset: NineAxisDataset) -> tuple[NineAxisDataset, int, int]:
    """Return the dataset without samples that repeat others, and how many at rest and turning.

    A stretch of ten samples that was there before, a value that stands still or a copy from
    elsewhere, measured nothing. Of a gyro's record that mostly repeats nothing counts.
    """
    still, at_rest = _without_repeats(
        [record.rate_deg_per_h for record in dataset.static], dead=False
    )
    sensed, also = _without_repeats([record.acceleration_g for record in dataset.static], most=1.0)
    axes = [record.axis for record in dataset.turns]
    spun, turning = _without_repeats([record.rate_deg_per_s for record in dataset.turns], axes)
    static = tuple(
        replace(record, rate_deg_per_h=rate, acceleration_g=force)
        for record, rate, force in zip(dataset.static, still, sensed, strict=True)
    )
    turns = tuple(
        replace(record, rate_deg_per_s=rate)
        for record, rate in zip(dataset.turns, spun, strict=True)
    )
    return replace(dataset, static=static, turns=turns), max(at_rest, also), turning


def _without_repeats(
    records: Sequence[Array],
    sorts: Sequence[int] = (),
    most: float = MOSTLY,
    *,
    dead: bool = True,
) -> tuple[list[Array], int]:
    """Return records (n, 3) with NaN in the place of repeats, and how many samples hold one.

    A channel that is so coarse that its neighbours often are alike is left as it is; that is judged
    by the records of one of the `sorts`. With `dead`, one that has a single value in all of them,
    though the sensor was turned between them, counts as repeats.
    """
    sorts = sorts or [0] * len(records)
    fine = {
        (sort, channel)
        for sort in set(sorts)
        for channel in range(3)
        if _usually_new([r[:, channel] for r, s in zip(records, sorts, strict=True) if s == sort])
        > ALWAYS_NEW
    }
    copies = [record.copy() for record in records]
    places = [(n, c) for n, sort in enumerate(sorts) for c in range(3) if (sort, c) in fine]
    repeated = [np.zeros(record.shape, dtype=bool) for record in records]
    again = repeated_windows([records[n][:, c] for n, c in places])
    for (n, c), own in zip(places, again, strict=True):
        repeated[n][:, c] = np.isfinite(records[n][:, c]) if own.mean() > most else own
    for sort in set(sorts) if dead else ():
        own_places = [n for n, other in enumerate(sorts) if other == sort]
        for channel in np.flatnonzero(_dead([records[n] for n in own_places])).tolist():
            for n in own_places:
                repeated[n][:, channel] = np.isfinite(records[n][:, channel])
    for copy, own in zip(copies, repeated, strict=True):
        copy[own] = np.nan
    return copies, sum(int(repeats.any(axis=1).sum()) for repeats in repeated)


def _dead(records: Sequence[Array]) -> Mask:
    """Return which channels (3,) have one value alone in ten and more samples of two records."""
    if len(records) < 2:
        return np.zeros(3, dtype=bool)
    together = np.vstack(records)
    finite = np.isfinite(together)
    many = finite.sum(axis=0) >= IN_A_ROW
    highest = np.max(together, axis=0, initial=-np.inf, where=finite)
    lowest = np.min(together, axis=0, initial=np.inf, where=finite)
    return np.asarray(many & (highest == lowest))


def _usually_new(columns: Sequence[Array]) -> float:
    """Return the median share of samples that differ from the one before.

    A long stretch that stands still does not count where it is the smaller part of its record.
    """
    shares = []
    for column in columns:
        if np.isfinite(column).sum() > 1:
            _, lengths = equal_runs(column)
            short = lengths[lengths < IN_A_ROW]
            moving = 2 * int(short.sum()) > len(column)
            changes = (len(lengths) - 1) / (len(column) - 1)
            shares.append(len(short) / int(short.sum()) if moving else changes)
    return float(np.median(shares)) if shares else 0.0
