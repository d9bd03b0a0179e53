"""Rows that are no measurement: overload, readings that cannot be, stand still, or are copies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from procedures.common.frozen import AFTER_A_COMMAND, COPIED_ROWS, equal_runs, frozen, frozen_flag
from procedures.estimation import channel
from procedures.estimation.flags import excitation_flags, gaps_of, rows_listed
from procedures.estimation.saturation import at_a_limit
from station.findings import Flag

from .dataset import AccelerometerDataset, LeftOut
from .parameters import AnalysisSettings

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
WILD_FIELD = 0.25
"""Of the largest commanded field: a reading further from the others cannot be the coil's field."""
WILD_SPREADS = 20.0
THERMOMETER = channel.Channel(
    "the temperature",
    "the thermometer",
    "degC",
    low=-80.0,
    high=400.0,
    harmless=0.5,
    slow=True,
)
NEARLY_ALIKE = 0.2
MOSTLY_NEW = 0.97
"""Of the other readings of a voltmeter or gaussmeter, where angle or field changed."""
ONE_STEP = 1.5
"""Readings that change by one same step are coarse."""
LONG_STAY = 1.5
"""Times the usual stay at an angle: a longer one may be an encoder that stands still."""
MOVED_PART, MOVED_V = 0.1, 5e-3
"""Of the spread of the output, and at least: no field moves the output so far at one angle."""
BEYOND = "beyond {:g} sigma from the fit"
OVERLOAD, STUCK, HELD = "overload of the voltmeter", "reading stands still", "angle stands still"
SATURATED, COPIED = "at the limit of voltmeter or device", "copy of an earlier row"
WARMTH = "temperature stands still"
FROZEN = (
    (
        WARMTH,
        "The temperature",
        "the thermometer",
        "",
        "No reading of it is used, and what warmed the device counts as drift. One that is too "
        "coarse to show a change looks alike: write all its digits into the file.",
    ),
    (
        STUCK,
        "The reading of voltmeter or gaussmeter",
        "the instrument",
        ", though the field changed",
        "These rows are left out. Look at the instrument, its trigger and its cable.",
    ),
    (
        HELD,
        "The angle",
        "the encoder",
        ", while the output moves as with the angle",
        "These rows are left out. Look at the encoder, its cable and what writes theta_deg.",
    ),
)
"""Readings that stand still: why a row is left out, what, of what, in spite of what, what to do."""


@dataclass(frozen=True)
class Screened:
    """The dataset, without a thermometer that stands still in the rows `still`, and which rows can
    be used (n,); why the others cannot."""

    dataset: AccelerometerDataset
    usable: Mask
    left_out: tuple[LeftOut, ...]
    still: NDArray[np.int64]


def screen(dataset: AccelerometerDataset) -> Screened:
    """Return which rows (n,) can be used at all, and why the others cannot.

    A wild reading of field or temperature must be found here: its row bends the model towards
    itself and leaves no residual. What is wrong by less shows in the residual of the output.
    """
    wild_degC = still = np.zeros(len(dataset), dtype=bool)
    if dataset.temperature_degC is not None:
        mounted = np.append(False, dataset.plane[1:] != dataset.plane[:-1])
        paused = channel.after_a_pause(dataset.time_s)
        warm = channel.screen(THERMOMETER, dataset.temperature_degC, free=mounted, paused=paused)
        still = warm.still | repeated_temperature(dataset.temperature_degC)
        wild_degC = warm.wild | warm.missing
        if still.any():
            dataset, wild_degC = replace(dataset, temperature_degC=None), still & False
    reasons = {
        OVERLOAD: dataset.overloaded,
        "no angle": ~np.isfinite(dataset.theta_deg),
        "angle off the plan's grid": ~np.isfinite(dataset.theta_commanded_deg),
        "no reading of the field": ~np.isfinite(dataset.field_T),
        STUCK: stuck(dataset.output_V, dataset) | stuck(dataset.field_T, dataset),
        HELD: held_angle(dataset),
        SATURATED: at_a_limit(dataset.output_V),
        COPIED: copied(dataset),
        "wild reading of the field": wild_field(dataset.field_T, dataset.field_commanded_T),
        "wild reading of the temperature": wild_degC,
    }
    usable = ~np.any(list(reasons.values()), axis=0)
    first = {
        int(row): reason for reason in reversed(reasons) for row in np.flatnonzero(reasons[reason])
    }
    left_out = tuple(LeftOut(row, first[row]) for row in sorted(first))
    return Screened(dataset, usable, left_out, np.flatnonzero(still))


def repeated_temperature(temperature_degC: Array) -> Mask:
    """Return which readings (n,) repeat the one before to the last digit, ten and more in a row.

    In few rows no noise tells a frozen thermometer from a coarse one, but that stands at several
    readings and changes by one same step.
    """
    still = frozen(temperature_degC)
    if len(np.unique(temperature_degC[still])) < 2:
        return still
    changes = np.abs(np.diff(temperature_degC))
    changes = changes[changes > 0.0]
    return still & (float(changes.max()) >= ONE_STEP * float(changes.min()))


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
    return far & (largest_T > 0.0)


def stuck(reading: Array, dataset: AccelerometerDataset) -> Mask:
    """Return which readings (n,) of voltmeter or gaussmeter repeat the one before them.

    To the last digit, though the commanded field changed, in three rows and more; none where
    readings are so coarse that others repeat, too.
    """
    changed = np.diff(dataset.field_commanded_T, prepend=np.nan) != 0.0
    if reading is dataset.output_V:
        changed |= np.diff(dataset.theta_commanded_deg, prepend=np.nan) != 0.0
    held = frozen(np.where(dataset.overloaded, np.nan, reading), AFTER_A_COMMAND) & changed
    again = np.append(False, reading[1:] == reading[:-1])
    others = again[changed & ~held]
    coarse = bool(len(others)) and float(others.mean()) > 1.0 - MOSTLY_NEW
    # The first of them may have been measured. Readings that are all the same are a field at rest.
    return np.asarray(held & again & (len(np.unique(reading)) > 1 and not coarse))


def held_angle(dataset: AccelerometerDataset) -> Mask:
    """Return which angles (n,) repeat the one before while the output moves as with the angle.

    In a longer stay than is usual, three rows and more whose outputs differ at one same field.
    """
    held = np.zeros(len(dataset), dtype=bool)
    read = ~dataset.overloaded
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
            held[first + 1 : first + count] = True  # The first of them was measured.
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
    there = output_V[np.isfinite(output_V)]
    step_V = channel.smallest_step(there)
    away = np.abs(there / step_V - np.rint(there / step_V)) if step_V > 0.0 else np.ones(1)
    return step_V if float(np.max(away)) < 0.01 else 0.0


def data_flags(
    screened: Screened, left_out: Sequence[LeftOut], settings: AnalysisSettings
) -> Iterator[Flag]:
    """Yield the flags on the rows: overload, rejected ones, gaps, and the field that was made."""
    dataset, still = screened.dataset, screened.still.tolist()
    rows: dict[str, list[int]] = {}
    for left in left_out:
        rows.setdefault(left.reason, []).append(left.row)
    for reason, reading, source, though, then in FROZEN:
        if at := still if reason == WARMTH else rows.pop(reason, []):
            extent = f"{len(at)} rows, from row {at[0]} on, counted from 0"
            details = {"count": len(at), "row": at[0], "what": source.removeprefix("the ")}
            yield frozen_flag(reading, extent, source, then, details, though=though)
    if at := rows.pop(OVERLOAD, []):
        yield Flag(
            "overload",
            f"The voltmeter was overloaded in {len(at)} rows (the first is row {at[0]}, counted "
            "from 0); they are left out.",
            details={"count": len(at), "rows": at},
        )
    if at := rows.pop(COPIED, []):
        yield Flag(
            "repeated-rows",
            f"{len(at)} rows, the first is row {at[0]}, counted from 0, hold field and output of "
            "an earlier row to the last digit: they were not measured, and are left out. Look at "
            "what wrote the file.",
            details={"count": len(at), "row": at[0]},
        )
    if at := rows.pop(SATURATED, []):
        yield Flag(
            "saturated",
            f"The output stands at {dataset.output_V[at[0]]:.6g} V in {len(at)} rows, the first "
            f"is row {at[0]}, counted from 0: voltmeter or device are at their limit, and these "
            "rows are left out. Take a higher range, or a smaller load resistor.",
            details={"count": len(at), "row": at[0]},
        )
    if rejected := sorted(chain.from_iterable(rows.values())):
        yield Flag(
            "outliers-rejected",
            f"{len(rejected)} of {len(dataset)} rows were left out ({'; '.join(rows)}): "
            f"{rows_listed(rejected)}.",
            details={"count": len(rejected), "rows": rejected},
        )
    if dataset.evenly_timed and len(dataset) > 2:
        steps_s = np.diff(dataset.time_s)
        nominal_s = float(np.median(steps_s))
        missing = int(np.sum(np.rint(steps_s / nominal_s) - 1.0))
        gaps = replace(gaps_of(dataset.time_s, nominal_s, settings.gap), missing=missing)
        yield from gaps.flags("The rows have", nominal_s, "the solution does not mind")
    good = np.ones(len(dataset), dtype=bool)
    good[[left.row for left in left_out]] = False
    yield from _field_flags(dataset.field_commanded_T[good], dataset.field_T[good], settings)


def _field_flags(commanded: Array, measured: Array, settings: AnalysisSettings) -> Iterator[Flag]:
    """Yield the flags of a field that does not follow its command: end to end, and by level.

    A constant ambient field is no excitation; where only one level was commanded it stays in.
    """
    driven = commanded != 0.0
    if not bool(driven.any()):
        return
    levels = np.unique(commanded)
    medians = np.array([np.median(measured[commanded == level]) for level in levels])
    if len(levels) > 1:
        share = float((medians[-1] - medians[0]) / (levels[-1] - levels[0]))
    else:
        share = float(medians[0] / levels[0])
    largest_T = float(np.max(np.abs(commanded)))
    yield from excitation_flags("dc", "dc", {"dc": share}, (largest_T, "T"))
    off = np.where(levels != 0.0, medians - levels, 0.0)
    worst = int(np.argmax(np.abs(off)))
    part = float(off[worst]) / largest_T
    if abs(part) > settings.field_differs_from_commanded:
        yield Flag(
            "field-differs-from-commanded",
            f"Where {levels[worst]:.5g} T was commanded, {medians[worst]:.5g} T was measured, off "
            f"by {100.0 * part:+.3g} % of the largest field; the result uses the measured field.",
            details={"relative_difference": part},
        )
