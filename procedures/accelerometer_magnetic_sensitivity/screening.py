"""Rows that are no measurement, and columns that mean something else than they say.

Rows: overload, readings of field or temperature that cannot be. Columns: another unit of the angle,
another plane; each mix-up that laboratories make is tried where the rows do not follow the model at
all. One that leaves a small part of what the stated one leaves is named, and nothing is reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.recorder import equal_runs
from station.findings import Flag

from .dataset import AccelerometerDataset, LeftOut, Rows
from .lost_signs import with_signs
from .model import PLANES, model_columns
from .nuisances import KO, KP, OFFSET
from .solved import Solution

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
WILD_FIELD = 0.25
"""Of the largest commanded field: a reading further from the others cannot be the coil's field."""
WILD_TEMPERATURE_K = 5.0
"""From the median of the rows around it: no accelerometer warms up so fast."""
WILD_SPREADS = 20.0
NEIGHBOURS = 5
FEWEST_FROZEN = 10
FEWEST_STUCK = 3
"""Voltmeter and gaussmeter read something new wherever angle or field changed."""
FEWEST_CLIPPED = 4
FEWEST_COPIED = 5
NEARLY_ALIKE = 0.2
STUCK = "reading stands still"
SATURATED = "at the limit of voltmeter or device"
COPIED = "copy of an earlier row"
USUALLY_NEW = 0.5
"""Of the other readings: a thermometer that repeats itself anyway is coarse, and not frozen."""
MOSTLY_NEW = 0.97
"""The same of a voltmeter or gaussmeter, where angle or field changed."""
ONE_STEP = 1.5
"""Readings that change by one same step are coarse."""
UNITS_DEG = {"rad": 180.0 / np.pi, "gon": 0.9, "turns": 360.0, "arcmin": 1 / 60, "arcsec": 1 / 3600}
POOR_PART = 1e-3
"""Noise of this part of the output's range is none of a voltmeter or an accelerometer."""
HOPELESS = 20.0
"""Times as much noise as that, and the model explains nothing; below, the device may be noisy."""
POOR_V = 1e-3
"""The same where no input acceleration spreads the output."""
MANY_STRAYS = 0.2
BETTER = 0.1
"""A reading of the columns that leaves so small a part of the rms is the right one."""
TILTED = 0.1
"""Of Ki: no accelerometer is mounted 6 deg off."""
TILTED_V_PER_G = 0.05
"""The same where Ki is not measured; the usual scale factor is 0.1 V/g and more."""
LARGE_OFFSET_DEG = 3.0


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
    note(clipped(dataset.output_V), SATURATED)
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
    held = frozen(np.where(dataset.overloaded, np.nan, reading), FEWEST_STUCK) & changed
    again = np.append(False, reading[1:] == reading[:-1])
    others = again[changed & ~held]
    if len(others) and float(others.mean()) > 1.0 - MOSTLY_NEW:
        return np.zeros(len(reading), dtype=bool)
    # The first of them may have been measured.
    return np.asarray(held & again)


def clipped(output_V: Array) -> Mask:
    """Return which readings (n,) stand at one same limit of the voltmeter or the device.

    Four and more that are the largest magnitude of one sign to the last digit, where readings are
    not so coarse that others repeat as often.
    """
    found = np.zeros(len(output_V), dtype=bool)
    values, count = np.unique(output_V[np.isfinite(output_V)], return_counts=True)
    if len(values) < 3:
        return found
    for end, others in ((0, count[1:]), (-1, count[:-1])):
        if count[end] >= FEWEST_CLIPPED and count[end] > 2 * int(others[1:-1].max(initial=1)):
            found |= output_V == values[end]
    return found


def copied(dataset: AccelerometerDataset) -> Mask:
    """Return which rows (n,) hold the field and the output of an earlier one to the last digit.

    Five and more that are the same number of rows behind, where so many cannot be alike by chance:
    where readings are not so coarse that outputs elsewhere are alike as often, or so far behind
    often differ by one step.
    """
    found = np.zeros(len(dataset), dtype=bool)
    if len(np.unique(dataset.output_V)) < 0.5 * len(dataset) or len(dataset) < FEWEST_COPIED:
        return found
    pairs = np.column_stack((dataset.output_V, dataset.field_T))
    later, behind = _alike(pairs)
    rows_behind, count = np.unique(behind, return_counts=True)
    step_V = coarse_step_V(dataset.output_V)
    far = [
        one
        for one, alike in zip(rows_behind.tolist(), count.tolist(), strict=True)
        if alike >= FEWEST_COPIED
        and _one_apart(dataset.output_V, one, step_V) < NEARLY_ALIKE * alike
    ]
    found[later[np.isin(behind, far)]] = True
    elsewhere = ~np.isin(_alike(pairs[:, :1])[1], far)
    return found if int(elsewhere.sum()) < int(found.sum()) else found & False


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
    found = frozen(temperature_degC, FEWEST_FROZEN)
    if len(np.unique(temperature_degC[found])) < 2:
        return found
    changes = np.abs(np.diff(temperature_degC))
    changes = changes[changes > 0.0]
    return found & (float(changes.max()) >= ONE_STEP * float(changes.min()))


def frozen(reading: Array, fewest: int) -> Mask:
    """Return which readings (n,) are `fewest` and more of the same in a row.

    None where half of the others repeat themselves, too: such readings are coarse.
    """
    starts, lengths = equal_runs(reading)
    frozen = np.repeat(lengths >= fewest, lengths)
    others = np.isin(np.flatnonzero(~frozen), starts)
    return frozen if not len(others) or float(others.mean()) > USUALLY_NEW else frozen & False


def misread_flags(rows: Rows, solution: Solution) -> tuple[list[Flag], bool]:
    """Return the flags of columns that do not mean what they say, and whether that is certain.

    Where it is, no coefficient can be reported.
    """
    values = dict(zip(solution.names, solution.coefficients, strict=True))
    poor_V = POOR_PART * float(np.std(rows.output_V)) if "Ki" in values else POOR_V
    noise_V = float(np.sqrt(np.mean(solution.residual_V**2)))
    strays = float(np.mean(~solution.kept))
    offset_deg = values.get(OFFSET, 0.0) / 3600.0
    poor = max(noise_V, solution.noise_V) > poor_V or strays > MANY_STRAYS
    explained = (solution.misfit, solution.cause, solution.jump) != (None, None, None)
    if poor or explained or abs(offset_deg) > LARGE_OFFSET_DEG:
        stated_V = _left(rows)
        tried = [(_left(other), said, details) for other, said, details in _readings(rows)]
        best_V, said, details = min(tried, key=lambda one: one[0])
        if best_V < BETTER * stated_V:
            if "statement" in details:
                unit_said = (
                    f"The column {details['statement']} {said}; nothing is reported. Correct it."
                )
                return [Flag("contradicts-statement", unit_said, details=details)], True
            plane_said = (
                f"The output fits where {said}, and not as stated; nothing is reported. Look at "
                "the mounting and at the columns plane and theta_deg."
            )
            return [Flag("wrong-position", plane_said, details=details)], True
    tilted = max(abs(values.get(name, 0.0)) for name in (KO, KP))
    if tilted > (TILTED * abs(values["Ki"]) if "Ki" in values else TILTED_V_PER_G):
        tilt_said = (
            f"The output has {tilted:.3g} V/g across the input axis: no mounting is so far off. "
            "Another plane or another zero of the angle was recorded; nothing is reported. Look "
            "at the mounting and at the columns plane and theta_deg."
        )
        details = {"misalignment_V_per_g": tilted}
        return [Flag("wrong-position", tilt_said, details=details)], True
    if abs(offset_deg) > LARGE_OFFSET_DEG:
        zero_said = (
            f"The zero of the encoder is {offset_deg:.4g} deg off, which the solution corrects: "
            "look whether the accelerometer is mounted as stated."
        )
        return [Flag("wrong-position", zero_said, details={"offset_deg": offset_deg})], False
    if solution.noise_V > HOPELESS * poor_V or strays > MANY_STRAYS:
        astray_said = (
            f"The output does not follow angle and field: {100.0 * strays:.2g} % of the rows are "
            f"left out, and the others miss the model by {1e6 * solution.noise_V:.3g} µV. No one "
            "cause explains that. Look at the columns, their units and their order."
        )
        return [Flag("misfit", astray_said, details={"what": "rows", "part": strays})], False
    return [], False


def _readings(rows: Rows) -> Iterator[tuple[Rows, str, dict[str, object]]]:
    """Yield other readings of the rows, each with what it says and its details."""
    for unit, factor in UNITS_DEG.items():
        details: dict[str, object] = {"statement": "theta_deg", "unit": unit}
        yield replace(rows, theta_rad=factor * rows.theta_rad), f"is in {unit}", details
    output_V, late = rows.output_V, "stands one row late"
    details = {"statement": "output_V"}
    yield replace(rows, output_V=np.append(output_V[1:], output_V[-1])), late, details
    early = "stands one row early"
    yield replace(rows, output_V=np.append(output_V[0], output_V[:-1])), early, details
    signed = with_signs(rows)
    if signed is not None:
        lost = "holds the size of the field without its sign, and so does field_commanded_T"
        yield signed, lost, {"statement": "field_T"}
    names = [str(name) for name in np.unique(rows.plane)]
    for name in names:
        there = rows.plane == name
        details = {"plane": name}
        if len(names) > 1:
            other = np.where(there, -rows.theta_rad, rows.theta_rad)
            said = f"plane {name} turns in the other sense"
            yield replace(rows, theta_rad=other), said, details
            for deg in (90, 180, 270):
                other = rows.theta_rad + np.radians(deg) * there
                said = f"plane {name} is turned by {deg} deg"
                yield replace(rows, theta_rad=other), said, details
        for new in PLANES:
            if new != name:
                other_plane = np.where(there, new, rows.plane)
                yield replace(rows, plane=other_plane), f"plane {name} is {new}", details
            if new in names and new > name:
                other_plane = np.where(rows.plane == new, name, np.where(there, new, rows.plane))
                said = f"the planes {name} and {new} are exchanged"
                yield replace(rows, plane=other_plane), said, details


def _left(rows: Rows) -> float:
    """Return the rms, in V, that model and misalignment leave of a reading of the rows."""
    acceleration_g = rows.accelerations()
    columns = np.column_stack(
        (model_columns(acceleration_g, rows.field_T), acceleration_g[:, 1:], rows.slope)
    )
    size = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(size > 0.0, size, 1.0)
    solved = np.linalg.lstsq(columns, rows.output_V, rcond=1e-9)[0]
    left_V = rows.output_V - np.einsum("ij,j->i", columns, solved)
    return float(np.sqrt(np.mean(left_V**2)))
