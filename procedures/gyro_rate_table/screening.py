"""From samples to record means: what is no output is left out, and the angle is taken with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.frozen import repeated_windows
from procedures.estimation.linear import robust_sigma
from procedures.estimation.noise import grid_index
from procedures.estimation.saturation import stands_at_top

from .dataset import Array, Mask, RateTableDataset, Record

FEWEST = 3
ALWAYS_NEW = 0.9
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
    frozen = frozen_samples(records)
    known = [np.isfinite(record.table_deg_per_interval) for record in records]
    apart = [
        record.rate_deg_per_s - scale * record.table_deg_per_interval / t0 for record in records
    ]
    usable = [k & ~f for k, f in zip(known, frozen, strict=True)]
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
    stood = sum(int(mask.sum()) for mask in frozen)
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
    slower = [
        other.rate_deg_per_s for other in records if 0.0 < abs(other.commanded_deg_per_s) < own
    ] or [other.rate_deg_per_s for other in records if abs(other.commanded_deg_per_s) < own]
    return bool(own) and stands_at_top(record.rate_deg_per_s, slower)


def frozen_samples(records: Sequence[Record]) -> list[Mask]:
    """Return which samples of each record repeat a stretch that was there before.

    Of coarse output, whose neighbours often are alike, none.
    """
    outputs = [record.rate_deg_per_s for record in records]
    new = [float(np.mean(np.diff(output) != 0.0)) for output in outputs if len(output) > 1]
    if not new or float(np.median(new)) < ALWAYS_NEW:
        return [np.zeros(len(output), dtype=bool) for output in outputs]
    return repeated_windows(outputs)


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
