"""From samples to record means: what is no output is left out, and what is seen within the records.

White noise and rounding, the wave that a lean brings per turn, and how the output runs while the
gyro is turned. A scale factor that drifts cannot from record to record be distinguished from a
nonlinearity: the rates follow one another. Within a record its output runs off in proportion to the
rate, W K' t: in opposite ways for the two senses of a rate, one after the other, where a bias that
drifts or warms up runs off alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.common.frozen import IN_A_SHORT_RECORD, frozen, repeated_windows
from procedures.estimation.channel import smallest_step
from procedures.estimation.linear import robust_sigma
from procedures.estimation.noise import grid_index
from procedures.estimation.rate_spectrum import coefficients, noise_variances
from procedures.estimation.reml import Stretch, fit
from procedures.estimation.saturation import STUCK, stands_at_top

from .dataset import Array, Mask, RateTableDataset, Record

FEWEST = 3
ALWAYS_NEW = 0.9
"""Part of the readings, frozen ones aside, that differ from the one before in no coarse output."""
STEPS_SHORT, CURVED = 3.0, 1e-4
"""By so many steps and such a part of its rate coarse output that is not cut off may be less."""
SHIFT_SEEN = 5.0
SMALLEST_SHIFT = 0.1
FAR_STEPS = 20.0
"""Changes of rate between samples over the usual ones from which a stamp's error is seen."""


@dataclass(frozen=True)
class Kept:
    """One record's good samples: `mean` and `table` in deg/h over exactly their intervals.

    `residual` (k,) is the output less K times the table's rate, in deg/h; `waves` (k, 2) the mean
    cosine and sine of the table's angle over each; `index` (k,) their places on the grid.
    """

    record: Record
    good: Mask
    mean: float
    table: float
    residual: Array
    waves: Array
    index: Array
    length_s: float
    turns: float


@dataclass(frozen=True)
class Screened:
    """All records with good samples, and what was left out; `shift` is by how many samples the
    stamps seem to be late, None where nothing shows it."""

    kept: tuple[Kept, ...]
    wild: int
    frozen: int
    saturated: tuple[Record, ...]
    unsteady_left_out: bool
    shift: float | None
    scale: float


def screen(dataset: RateTableDataset, beyond: float) -> Screened:
    """Return the good samples of all records; `beyond` in robust standard deviations.

    Saturated records go whole: what is cut off at one end makes the mean of the others wrong.
    """
    cut = [record for record in dataset.records if is_saturated(record, dataset.records)]
    records = [record for record in dataset.records if not any(record is other for other in cut)]
    t0 = dataset.sample_interval_s
    scale = rough_scale(records, t0)
    still = frozen_samples(records)
    known = [np.isfinite(record.table_deg_per_interval) for record in records]
    apart = [
        record.rate_deg_per_s - scale * record.table_deg_per_interval / t0 for record in records
    ]
    usable = [k & ~f for k, f in zip(known, still, strict=True)]
    sigmas = [robust_sigma(a[u]) for a, u in zip(apart, usable, strict=True) if u.sum() > FEWEST]
    usual = float(np.median(sigmas)) if sigmas else 0.0
    slack = dataset.quantum_deg_per_s
    good = []
    for own, use in zip(apart, usable, strict=True):
        if not use.any():
            good.append(use)
            continue
        sigma = max(usual, robust_sigma(own[use]), 0.3 * slack)
        near = np.abs(own - np.median(own[use])) <= beyond * sigma + slack
        good.append(use & near if sigma > 0.0 else use)
    wild = sum(int(np.sum(u & ~g)) for u, g in zip(usable, good, strict=True))
    shift = stamp_shift(records, good, scale, t0)
    if shift is not None:
        good = [g & steady(record) for g, record in zip(good, records, strict=True)]
    kept = tuple(
        _kept(record, g, scale, t0) for record, g in zip(records, good, strict=True) if g.any()
    )
    stood = sum(int(mask.sum()) for mask in still)
    return Screened(kept, wild, stood, tuple(cut), shift is not None, shift, scale)


def _kept(record: Record, good: Mask, scale: float, t0: float) -> Kept:
    table = record.table_deg_per_interval[good] / t0 * SECONDS_PER_HOUR
    output = record.rate_deg_per_s[good] * SECONDS_PER_HOUR
    middle = np.radians(0.5 * (record.start_deg + record.end_deg)[good])
    shrunk = np.sinc(record.table_deg_per_interval[good] / 360.0)
    known = np.isfinite(record.table_deg_per_interval)
    turned = np.nanmax(record.end_deg[known]) - np.nanmin(record.start_deg[known])
    if record.commanded_deg_per_s < 0.0:
        turned = np.nanmax(record.start_deg[known]) - np.nanmin(record.end_deg[known])
    return Kept(
        record,
        good,
        float(output.mean()),
        float(table.mean()),
        output - scale * table,
        np.column_stack((np.cos(middle), np.sin(middle))) * shrunk[:, None],
        grid_index(record.time_s[good], t0).astype(np.float64),
        float(good.sum()) * t0,
        abs(float(turned)) / 360.0,
    )


def rough_scale(records: Sequence[Record], t0: float) -> float:
    """Return the scale factor as the median over the turning records, 1 without any."""
    ratios = []
    for record in records:
        table = record.table_deg_per_interval / t0
        known = np.isfinite(table)
        if record.commanded_deg_per_s and known.any() and float(np.median(table[known])):
            ratio = np.median(record.rate_deg_per_s[known]) / np.median(table[known])
            ratios.append(float(ratio))
    return float(np.median(ratios)) if ratios else 1.0


def is_saturated(record: Record, records: Sequence[Record]) -> bool:
    """Return whether the output of a record is cut off, judged by the records of lower rates."""
    own = abs(record.commanded_deg_per_s)
    turning = [other for other in records if 0.0 < abs(other.commanded_deg_per_s) < own]
    slower = turning or [other for other in records if abs(other.commanded_deg_per_s) < own]
    if not own or not stands_at_top(record.rate_deg_per_s, [o.rate_deg_per_s for o in slower]):
        return False
    return not turning or _falls_short(record, turning)


def _falls_short(record: Record, slower: Sequence[Record]) -> bool:
    """Return whether a record stands below its rate by more than steps and a curve of it explain.

    True where output is not coarse: any of it that stands at one level for long is cut off.
    """
    shares = [np.unique(other.rate_deg_per_s, return_counts=True)[1].max() for other in slower]
    lengths = [len(other.rate_deg_per_s) for other in slower]
    if float(np.median(np.divide(shares, lengths))) < STUCK:
        return True
    step = max(smallest_step(other.rate_deg_per_s) for other in slower)
    expected = rough_scale(slower, 1.0) * np.nanmedian(record.table_deg_per_interval)
    missing = abs(expected) - float(np.median(np.abs(record.rate_deg_per_s)))
    return bool(missing > STEPS_SHORT * step + CURVED * abs(expected))


def frozen_samples(records: Sequence[Record]) -> list[Mask]:
    """Return which samples of each record stand still, or repeat a stretch that was there before.

    Of coarse output, whose neighbours often are alike, none.
    """
    outputs = [record.rate_deg_per_s for record in records]
    still = [frozen(output, IN_A_SHORT_RECORD) for output in outputs]
    others = [np.diff(o[~s]) for o, s in zip(outputs, still, strict=True) if np.sum(~s) > 1]
    if not others or float(np.median([np.mean(step != 0.0) for step in others])) < ALWAYS_NEW:
        return [np.zeros(len(output), dtype=bool) for output in outputs]
    return [s | copied for s, copied in zip(still, repeated_windows(outputs), strict=True)]


def steady(record: Record) -> Mask:
    """Return the samples (n,) in which the table was at its rate.

    After a settling that was seen as much again is left out, for its end is not seen.
    """
    begins = np.flatnonzero(record.unsteady[: len(record.unsteady) // 2])
    settled = 2 * (int(begins[-1]) + 1) if len(begins) else 0
    return np.asarray(~record.unsteady & (np.arange(len(record.unsteady)) >= settled))


def stamp_shift(
    records: Sequence[Record], good: Sequence[Mask], scale: float, t0: float
) -> float | None:
    """Return by how many samples the outputs come later than their stamps, None for none seen.

    Where the table gains or loses speed, output and angle of different intervals do not agree.
    """
    apart, steps = [], []
    for record, use in zip(records, good, strict=True):
        known = np.isfinite(record.table_deg_per_interval)
        if known.sum() < 5 or not bool(record.unsteady.any()):
            continue
        table = record.table_deg_per_interval / t0
        step = np.zeros(len(table))
        step[1:-1] = 0.5 * (table[2:] - table[:-2])
        near = known.copy()
        near[1:-1] &= known[2:] & known[:-2]
        near[[0, -1]] = False
        usual = float(np.median(np.abs(step[near]))) if near.any() else 0.0
        moving = near & (np.abs(step) > FAR_STEPS * usual)
        left = record.rate_deg_per_s - scale * table
        apart.append((left - np.median(left[use]) if use.any() else left)[moving])
        steps.append(scale * step[moving])
    if not steps or sum(len(step) for step in steps) < FEWEST:
        return None
    x, y = np.concatenate(steps), np.concatenate(apart)
    slope = float(x @ y / (x @ x))
    left = y - slope * x
    u = float(np.sqrt(left @ left / max(len(x) - 1, 1) / (x @ x)))
    return -slope if abs(slope) > max(SHIFT_SEEN * u, SMALLEST_SHIFT) else None


SHORTEST = 5
LEAN = 0.02
"""Sine of the angle by which the input axis may lean from the table's, as a standard deviation."""


@dataclass(frozen=True)
class Within:
    """What is seen within the records, in deg/h.

    `squares` (2,) are Q² in arcsec² and N² in (deg/h)² s. `normal` (2, 2) and `right` (2,) are the
    normal equations of cosine and sine amplitude of the table's angle, prior included.
    """

    squares: Array
    normal: Array
    right: Array

    def variance(self, length_s: Array) -> Array:
        """Return the variance of means over times (r,)."""
        return np.asarray(self.squares[1] / length_s + 2.0 * self.squares[0] / length_s**2)


def within_records(
    records: Sequence[Kept], interval_s: float, level_deg_per_h: float
) -> Within | None:
    """Return noise and wave of the records; None where none is long enough.

    The noise is that of output less table rate: it holds the encoder's, which a mean shares.
    """
    prior = np.eye(2) / max(LEAN * level_deg_per_h, 1e-3) ** 2
    squares = np.zeros(2)
    normal, right = prior, np.zeros(2)
    for _ in range(2):
        # The wave is small beside a sample's noise: twice is enough.
        amplitude: Array = np.asarray(np.linalg.solve(normal, right), dtype=np.float64)
        stretches = [
            stretch for kept in records for stretch in _stretches(kept, interval_s, amplitude)
        ]
        if not stretches:
            return None
        squares = fit(stretches).theta
        sample = float(squares[1] / interval_s + 2.0 * squares[0] / interval_s**2)
        cross, data = np.zeros((2, 2)), np.zeros(2)
        for kept in records:
            waves = kept.waves - kept.waves.mean(axis=0)
            cross += waves.T @ waves
            data += waves.T @ (kept.residual - kept.residual.mean())
        normal, right = prior + cross / max(sample, 1e-12), data / max(sample, 1e-12)
    return Within(squares, normal, right)


def _stretches(kept: Kept, interval_s: float, amplitude: Array) -> list[Stretch]:
    """Return a record's unbroken stretches in cosine coefficients."""
    level = kept.residual - kept.waves @ amplitude
    stretches = []
    for piece in np.split(level, np.flatnonzero(np.diff(kept.index) != 1.0) + 1):
        if len(piece) >= SHORTEST and float(np.ptp(piece)) > 0.0:
            parts = noise_variances(len(piece), interval_s)[:2]
            count = len(piece) - 1
            stretches.append(
                Stretch(coefficients(piece), parts, np.zeros(count), np.zeros((count, 0)))
            )
    return stretches


@dataclass(frozen=True)
class Runs:
    """How outputs run within records, less the mean of the same rate in both senses.

    `slope` and its `u` (r,) are in deg/h per h, u infinite for records that are too short; `rate`
    (r,) is what a drift of 1 per h makes of it.
    """

    slope: Array
    rate: Array
    u: Array


def runs_of(records: Sequence[Kept], within: Within, interval_s: float) -> Runs:
    """Return how the output less K times the table's rate runs within the records."""
    amplitude = np.linalg.solve(within.normal, within.right)
    sample = within.squares[1] / interval_s + 2.0 * within.squares[0] / interval_s**2
    slope, u = np.zeros(len(records)), np.full(len(records), np.inf)
    for number, kept in enumerate(records):
        time_h = (kept.index - kept.index.mean()) * interval_s / SECONDS_PER_HOUR
        square = float(time_h @ time_h)
        if len(time_h) >= SHORTEST and sample > 0.0:
            slope[number] = float(time_h @ (kept.residual - kept.waves @ amplitude)) / square
            u[number] = float(np.sqrt(sample / square))
    repeats = np.array([kept.record.repeat for kept in records])
    sizes = np.array([abs(kept.record.commanded_deg_per_s) for kept in records])
    rate = np.array([kept.table if kept.record.commanded_deg_per_s else 0.0 for kept in records])
    for repeat in np.unique(repeats):
        for size in np.unique(sizes):
            own = (repeats == repeat) & (sizes == size)
            weight = 1.0 / u[own] ** 2
            total = float(weight.sum())
            for values in (slope, rate):
                values[own] -= float(weight @ values[own]) / total if total > 0.0 else values[own]
    return Runs(slope, rate, u)
