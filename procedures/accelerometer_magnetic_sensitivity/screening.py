"""Rows that are no measurement: overload, and readings that cannot be or stand still."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.frozen import AFTER_A_COMMAND, COPIED_ROWS, equal_runs, frozen
from procedures.estimation.saturation import at_a_limit

from .dataset import AccelerometerDataset, LeftOut

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
WILD_FIELD = 0.25
"""Of the largest commanded field: a reading further from the others cannot be the coil's field."""
WILD_TEMPERATURE_K = 5.0
"""From the median of the rows around it: no accelerometer warms up so fast."""
WILD_SPREADS = 20.0
NEIGHBOURS = 5
NEARLY_ALIKE = 0.2
STUCK = "reading stands still"
HELD = "angle stands still while the output moves"
SATURATED = "at the limit of voltmeter or device"
COPIED = "copy of an earlier row"
MOSTLY_NEW = 0.97
"""Of the other readings of a voltmeter or gaussmeter, where angle or field changed."""
ONE_STEP = 1.5
"""Readings that change by one same step are coarse."""
LONG_STAY = 1.5
"""Times the usual stay at an angle: a longer one may be an encoder that stands still."""
MOVED_PART, MOVED_V = 0.1, 5e-3
"""Of the spread of the output, and at least: no field moves the output so far at one angle."""


def screen(dataset: AccelerometerDataset) -> tuple[Mask, tuple[LeftOut, ...]]:
    """Return which rows (n,) can be used at all, and why the others cannot.

    A wild reading of field or temperature must be found here: its row bends the model towards
    itself and leaves no residual. What is wrong by less shows in the residual of the output.
    """
    reasons: dict[int, str] = {}

    def note(rows: Mask, reason: str) -> None:
        for row in np.flatnonzero(rows):
            reasons.setdefault(int(row), reason)

    note(dataset.overloaded, "overload of the voltmeter")
    note(~np.isfinite(dataset.theta_deg), "no angle")
    note(~np.isfinite(dataset.theta_commanded_deg), "angle off the plan's grid")
    note(~np.isfinite(dataset.field_T), "no reading of the field")
    note(stuck(dataset.output_V, dataset) | stuck(dataset.field_T, dataset), STUCK)
    note(held_angle(dataset), HELD)
    note(at_a_limit(dataset.output_V), SATURATED)
    note(copied(dataset), COPIED)
    note(wild_field(dataset.field_T, dataset.field_commanded_T), "wild reading of the field")
    if dataset.temperature_degC is not None:
        note(wild_temperature(dataset.temperature_degC), "wild reading of the temperature")
    good = np.ones(len(dataset), dtype=bool)
    good[list(reasons)] = False
    return good, tuple(LeftOut(row, reasons[row]) for row in sorted(reasons))


def wild_field(field_T: Array, commanded_T: Array) -> Mask:
    """Return which readings lie far from what the others say of the commanded field, (n,)."""
    finite = np.isfinite(field_T)
    if not bool(finite.any()):
        return ~finite
    largest_T = float(np.max(np.abs(commanded_T)))
    strong = finite & (np.abs(commanded_T) > 0.2 * largest_T)
    gain = float(np.median(field_T[strong] / commanded_T[strong])) if bool(strong.any()) else 1.0
    off = field_T - gain * commanded_T
    middle = float(np.median(off[finite]))
    spread = float(np.median(np.abs(off[finite] - middle)))
    far = np.abs(off - middle) > max(WILD_FIELD * largest_T, WILD_SPREADS * spread)
    return ~finite | (far & (largest_T > 0.0))


def wild_temperature(temperature_degC: Array) -> Mask:
    """Return which readings lie far from those before and after them, (n,)."""
    finite = np.isfinite(temperature_degC)
    if not bool(finite.any()):
        return ~finite
    padded = np.pad(temperature_degC, NEIGHBOURS, mode="reflect") if len(finite) > 5 else None
    if padded is None:
        around = np.full(len(finite), float(np.nanmedian(temperature_degC)))
    else:
        around = np.nanmedian(
            np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1), axis=1
        )
    off = np.abs(temperature_degC - around)
    spread = float(np.nanmedian(off))
    wild = ~finite | (off > max(WILD_TEMPERATURE_K, WILD_SPREADS * spread))
    return np.asarray(wild, dtype=np.bool_)


def stuck(reading: Array, dataset: AccelerometerDataset) -> Mask:
    """Return which readings (n,) of voltmeter or gaussmeter repeat the one before them, (n,).

    To the last digit, though the commanded field changed, in three rows and more; none where
    readings are so coarse that others repeat, too.
    """
    if len(np.unique(reading)) < 2:
        return np.zeros(len(reading), dtype=bool)
    changed = np.diff(dataset.field_commanded_T, prepend=np.nan) != 0.0
    if reading is dataset.output_V:
        changed |= np.diff(dataset.theta_commanded_deg, prepend=np.nan) != 0.0
    held = frozen(np.where(dataset.overloaded, np.nan, reading), AFTER_A_COMMAND) & changed
    again = np.append(False, reading[1:] == reading[:-1])
    others = again[changed & ~held]
    if len(others) and float(others.mean()) > 1.0 - MOSTLY_NEW:
        return np.zeros(len(reading), dtype=bool)
    # The first of them may have been measured.
    return np.asarray(held & again)


def held_angle(dataset: AccelerometerDataset) -> Mask:
    """Return which angles (n,) repeat the one before while the output moves as with the angle.

    In a longer stay than is usual, three rows and more whose outputs differ at one same field.
    """
    held = np.zeros(len(dataset), dtype=bool)
    read = np.isfinite(dataset.output_V) & ~dataset.overloaded
    if int(read.sum()) < AFTER_A_COMMAND:
        return held
    starts, lengths = equal_runs(dataset.theta_deg)
    moved_V = max(MOVED_PART * float(np.std(dataset.output_V[read])), MOVED_V)
    long = max(LONG_STAY * float(np.median(lengths)), AFTER_A_COMMAND)
    for first, count in zip(starts[lengths >= long], lengths[lengths >= long], strict=True):
        stay = first + np.flatnonzero(read[first : first + count])
        levels, field = np.unique(dataset.field_commanded_T[stay], return_inverse=True)
        output_V = dataset.output_V[stay]
        usual_V = np.array([np.median(output_V[field == level]) for level in range(len(levels))])
        if int(np.sum(np.abs(output_V - usual_V[field]) > moved_V)) >= AFTER_A_COMMAND:
            # The first of them was measured.
            held[first + 1 : first + count] = True
    return held


def copied(dataset: AccelerometerDataset) -> Mask:
    """Return which rows (n,) hold the field and the output of an earlier one to the last digit.

    Five and more that are the same number of rows behind, where so many cannot be alike by chance:
    where readings are not so coarse that outputs elsewhere are alike as often, or so far behind
    often differ by one step.
    """
    copies = np.zeros(len(dataset), dtype=bool)
    if len(np.unique(dataset.output_V)) < 0.5 * len(dataset) or len(dataset) < COPIED_ROWS:
        return copies
    pairs = np.column_stack((dataset.output_V, dataset.field_T))
    later, behind = _alike(pairs)
    rows_behind, count = np.unique(behind, return_counts=True)
    step_V = coarse_step_V(dataset.output_V)
    far = [
        rows
        for rows, alike in zip(rows_behind.tolist(), count.tolist(), strict=True)
        if alike >= COPIED_ROWS
        and _one_apart(dataset.output_V, rows, step_V) < NEARLY_ALIKE * alike
    ]
    copies[later[np.isin(behind, far)]] = True
    elsewhere = ~np.isin(_alike(pairs[:, :1])[1], far)
    return copies if int(elsewhere.sum()) < int(copies.sum()) else copies & False


def _one_apart(output_V: Array, behind: int, step_V: float) -> int:
    """Return how many outputs (n,) differ by one step from the one so many rows behind."""
    apart_V = np.abs(output_V[behind:] - output_V[:-behind])
    return int(np.sum(np.abs(apart_V - step_V) < 0.5 * step_V))


def _alike(values: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows of `values` (n, k) that an earlier one equals, and how far it is behind."""
    kind = np.unique(values, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(kind, kind="stable")
    same = np.diff(kind[order]) == 0
    earlier, later = order[:-1][same], order[1:][same]
    return later, later - earlier


def coarse_step_V(output_V: Array) -> float:
    """Return the step of which all readings are multiples, 0 where there is none.

    A voltmeter's last digit is below its noise; where it is above, the error of a reading repeats
    with the reading.
    """
    values = np.unique(output_V[np.isfinite(output_V)])
    step_V = float(np.min(np.diff(values), initial=np.inf))
    if not np.isfinite(step_V) or step_V <= 0.0:
        return 0.0
    away = np.abs(values / step_V - np.rint(values / step_V))
    return step_V if float(np.max(away)) < 0.01 else 0.0


def frozen_temperature(temperature_degC: Array) -> Mask:
    """Return which readings (n,) repeat the one before to the last digit, ten and more in a row.

    A thermometer that stands still measures nothing, and what warms the device goes unseen. One
    that stands at several readings and only changes by one same step is coarse.
    """
    still = frozen(temperature_degC)
    if len(np.unique(temperature_degC[still])) < 2:
        return still
    changes = np.abs(np.diff(temperature_degC))
    changes = changes[changes > 0.0]
    return still & (float(changes.max()) >= ONE_STEP * float(changes.min()))
