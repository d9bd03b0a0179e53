"""What the calibration of a nine-axis sensor needs, without samples that measured nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from procedures.common.frozen import (
    IN_A_ROW,
    equal_runs,
    repeated_windows,
)
from procedures.estimation.saturation import stands_at_top

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Counts = NDArray[np.int64]

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
class Screened:
    """The dataset without samples that measured nothing, NaN in their place, and how many.

    `saturated` holds axis, rate and number of each record on the table. `frozen` (3, 3) counts the
    samples that repeat others, in rows of gyros at rest, gyros turning, accelerometers at rest.
    """

    dataset: NineAxisDataset
    saturated: tuple[tuple[int, float, int], ...]
    saturated_at_rest: int
    frozen: Counts


def screened(dataset: NineAxisDataset) -> Screened:
    """Return what measured something.

    A record of which more than a hundredth is saturated is left out: what is cut off at one end
    makes the mean of the others wrong. Where the range is not known, output that stands still at
    its largest value, and does not at slower rates, counts as saturated. A stretch of ten samples
    that was there before, a value that stands still or a copy from elsewhere, measured nothing. Of
    a gyro's record that mostly repeats nothing counts.
    """
    limit = np.inf if dataset.largest_rate_deg_per_s is None else dataset.largest_rate_deg_per_s
    limit *= AT_THE_END
    axes = [record.axis for record in dataset.turns]
    saturated, spun = [], []
    for record in dataset.turns:
        over = np.abs(record.rate_deg_per_s) >= limit
        own = over[:, record.axis]
        if not bool(own.any()):
            own[:] = _stands_still(record, dataset.turns)
        if count := int(own.sum()):
            saturated.append((record.axis, record.commanded_deg_per_s, count))
        over[:, over.mean(axis=0) > MAX_OF_A_RECORD] = True
        spun.append(np.where(over, np.nan, record.rate_deg_per_s))
    over_at_rest = [np.abs(record.rate_deg_per_h) / 3600.0 >= limit for record in dataset.static]
    still = [
        np.where(over, np.nan, record.rate_deg_per_h)
        for over, record in zip(over_at_rest, dataset.static, strict=True)
    ]
    felt = [record.acceleration_g for record in dataset.static]
    still, at_rest = _without_repeats(still, [0] * len(still))
    felt, accelerometers = _without_repeats(felt, [0] * len(felt), most=1.0, dead=True)
    spun, turning = _without_repeats(spun, axes, dead=True)
    sound = replace(
        dataset,
        static=tuple(
            replace(record, rate_deg_per_h=rate, acceleration_g=force)
            for record, rate, force in zip(dataset.static, still, felt, strict=True)
        ),
        turns=tuple(
            replace(record, rate_deg_per_s=rate)
            for record, rate in zip(dataset.turns, spun, strict=True)
        ),
    )
    beyond = sum(int(own.sum()) for own in over_at_rest)
    return Screened(sound, tuple(saturated), beyond, np.stack((at_rest, turning, accelerometers)))


def _stands_still(record: TurnRecord, turns: Sequence[TurnRecord]) -> bool:
    """Return whether output stands at its largest value as it never does at slower rates."""
    slower = [
        own
        for turn in turns
        if turn.axis == record.axis
        and abs(turn.commanded_deg_per_s) < abs(record.commanded_deg_per_s)
        and np.isfinite(own := turn.rate_deg_per_s[:, turn.axis]).any()
    ]
    return stands_at_top(record.rate_deg_per_s[:, record.axis], slower)


def _without_repeats(
    records: Sequence[Array],
    sorts: Sequence[int],
    most: float = MOSTLY,
    *,
    dead: bool = False,
) -> tuple[list[Array], Counts]:
    """Return records (n, 3) with NaN in the place of repeats, and how many of each axis, (3,).

    A channel that is so coarse that its neighbours often are alike is left as it is, unless it is
    `dead` and never changes, though the sensor was turned; that is judged by the records of one of
    the `sorts`. Of a record that repeats in more than the part `most` nothing is left.
    """
    fine, never = set(), set()
    for sort in set(sorts):
        for channel in range(3):
            own = [r[:, channel] for r, s in zip(records, sorts, strict=True) if s == sort]
            if dead and len(own) > 1 and _never_changes(own):
                never.add((sort, channel))
            elif _usually_new(own) > ALWAYS_NEW:
                fine.add((sort, channel))
    places = [(n, c) for n, sort in enumerate(sorts) for c in range(3) if (sort, c) in fine]
    repeated = [
        np.isfinite(record) & [(sort, channel) in never for channel in range(3)]
        for sort, record in zip(sorts, records, strict=True)
    ]
    again = repeated_windows([records[n][:, c] for n, c in places])
    for (n, c), mask in zip(places, again, strict=True):
        repeated[n][:, c] = np.isfinite(records[n][:, c]) if mask.mean() > most else mask
    sound = [np.where(own, np.nan, r) for own, r in zip(repeated, records, strict=True)]
    return sound, sum((own.sum(axis=0) for own in repeated), np.zeros(3, dtype=np.int64))


def _never_changes(columns: Sequence[Array]) -> bool:
    together = np.concatenate(columns)
    there = together[np.isfinite(together)]
    return len(there) >= IN_A_ROW and len(np.unique(there)) == 1


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
