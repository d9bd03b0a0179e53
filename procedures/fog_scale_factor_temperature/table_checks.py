"""Columns of turns that cannot be what their names say: units, axes, thermometers, copied rows."""

from __future__ import annotations

import numpy as np

from procedures.common.constants import FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.estimation.flags import frozen
from procedures.estimation.frozen import TURNS_IN_A_ROW, equal_runs
from station.findings import Flag, contradiction

from .dataset import AXES, Array, FogDataset, Mask, TurnTable, rotation_to_navigation

RADIANS = 2.0 * np.pi
UNITS = {
    "radians": RADIANS,
    "gon": 400.0,
    "turns": 1.0,
    "mils": 6400.0,
    "minutes": 21600.0,
    "degrees and minutes, DDMM.mm": 36000.0,
    "seconds": 1296000.0,
}
"""Of headings that are no degrees, and what one turn is in them."""
FILLED = 9
"""Tenths of a circle that headings which may be any are in, all but seldom."""
JUMPS = 0.1
"""Of a circle, from turn to turn: headings that may be any, none that wander."""
FEWEST_HEADINGS = 20
UPRIGHT_DEG = 5.0
"""From the vertical: an axis that points up."""
FASTEST_DEG_PER_S, SLOWEST_DEG_PER_S = 1000.0, 0.1
FASTEST_DEGC_PER_H = 200.0
"""No table, no gyro is as fast as that."""
OUTSIDE_RANGE_DEGC = 15.0
FROM_CHAMBER_DEGC = 40.0
COARSER = 2.5
"""Than stated: steps of the headings."""
AFTER_BEFORE_DEGC = 5.0
SAME_DEGC = 0.011
FINE_DEGC = 0.05
"""Of a thermometer: one that is coarser stands still at a soak, too."""
FROM_OTHERS_DEGC = 4.0
"""Of the thermometers of two gyros in one housing: how far their difference goes up and down."""
FROZEN_SETS = 3


def unit_of_headings(table: TurnTable, full_attitude: bool) -> str | None:
    """Return the unit of the headings where they are no degrees, else None.

    Headings that may be any fill one turn of their unit, from zero or about it, and go nowhere
    beyond; degrees, minutes and seconds have no fraction above 0.6. With pitch and roll: radians
    where those of axes that point up lie at pi/2.
    """
    angles = np.concatenate((table.attitude_before_deg, table.attitude_after_deg))
    headings = angles[:, 0][np.isfinite(angles[:, 0])]
    if len(headings) < FEWEST_HEADINGS:
        return None
    if full_attitude:
        leaning = np.max(np.abs(angles[:, 1:]), axis=1)
        leaning = leaning[np.isfinite(leaning)]
        right = len(leaning) > 0 and abs(float(np.median(leaning)) - 0.25 * RADIANS) < 0.1
        return "radians" if right and float(np.max(leaning)) < RADIANS else None
    span = float(np.ptp(headings))
    jumps = float(np.nanmedian(np.abs(np.diff(table.attitude_before_deg[:, 0]))))
    for unit, turn in UNITS.items():
        low = -0.5 * turn if float(headings.min()) < 0.0 else 0.0
        share = (headings - low) / turn
        inside = float(share.min()) >= 0.0 and float(share.max()) <= 1.0 + 1e-3
        tenths = len(np.unique(np.floor(np.minimum(share, 0.999) * 10.0)))
        beyond = turn < FULL_TURN_DEG or span > FULL_TURN_DEG + 1.0
        if inside and tenths >= FILLED and beyond and jumps > JUMPS * turn:
            return unit
    minutes = np.mod(np.abs(headings), 1.0) * 100.0
    seconds = np.mod(minutes + 1e-6, 1.0) * 100.0
    sixty = float(minutes.max()) < 60.0 and float(seconds.max()) < 60.1
    filled = len(np.unique(np.floor(minutes / 10.0))) == 6
    if sixty and filled and len(headings) > 2 * FEWEST_HEADINGS:
        return "degrees, minutes and seconds, DD.MMSS"
    return None


def units_of_headings(table: TurnTable, full_attitude: bool) -> dict[str, str]:
    """Return the unit of the headings of each axis in which they are no degrees.

    An axis with few turns has the unit of the whole table.
    """
    whole = unit_of_headings(table, full_attitude)
    own = {str(axis): table.of(table.axis == axis) for axis in np.unique(table.axis)}
    units = {axis: unit_of_headings(turns, full_attitude) for axis, turns in own.items()}
    known = any(units.values())
    return {
        axis: str(unit or whole)
        for axis, unit in units.items()
        if unit or (whole and (not known or len(own[axis]) < FEWEST_HEADINGS))
    }


def upright(table: TurnTable, full_attitude: bool) -> Mask:
    """Return in which rows the attitude has the named axis up, (rows,); all without attitude."""
    if not full_attitude:
        return np.ones(len(table), dtype=bool)
    places = np.array([AXES.index(axis) for axis in table.axis], dtype=np.int64)
    cosine = np.ones(len(table))
    for attitude in (table.attitude_before_deg, table.attitude_after_deg):
        down = rotation_to_navigation(attitude)[np.arange(len(table)), 2, places]
        cosine = np.minimum(cosine, -np.where(np.isfinite(down), down, 0.0))
    return np.asarray(cosine > np.cos(np.radians(UPRIGHT_DEG)))


def table_flags(dataset: FogDataset) -> list[Flag]:
    """Return the flags of columns that cannot be what their names say, whatever the curve."""
    flags = []
    for name, table in (("turns", dataset.turns), ("verification", dataset.verification)):
        if table is None or not len(table):
            continue
        units = units_of_headings(table, dataset.full_attitude)
        for unit in sorted(set(units.values())):
            axes = [axis for axis, own in units.items() if own == unit]
            unit_text = (
                f"The headings of `{name}` about {', '.join(axes)} look like {unit}: they fill one "
                "turn of that unit and no more. The columns are in degrees; nothing is reported "
                "from them. Convert them."
            )
            flags.append(contradiction("heading_deg", unit_text, file=name, axes=axes))
        named = table.axis[~upright(table, dataset.full_attitude)]
        wrong = sorted({str(axis) for axis in named} - set(units))
        if wrong:
            axis_text = (
                f"In `{name}` the attitude does not have the axis up that the row names "
                f"({', '.join(wrong)}): an axis called by another's name, mounted upside down, or "
                "pitch and roll exchanged. Such turns are left out. Correct the column `axis`."
            )
            flags.append(contradiction("axis", axis_text, axes=wrong, file=name))
        flags += _temperature_flags(dataset, name, table)
        flags += _times(name, table) + _resolution(dataset, name, table)
    return flags


def _times(name: str, table: TurnTable) -> list[Flag]:
    """Return the flag of times that make table or gyro impossibly fast or slow."""
    turning = np.abs(table.commanded_deg) > 0.0
    heat = table.temperature_degC[np.isfinite(table.temperature_degC)]
    if int(turning.sum()) < FEWEST_HEADINGS or not len(heat):
        return []
    speed = float(np.median(np.abs(table.commanded_deg[turning]) / table.duration_s[turning]))
    span_h = float(np.ptp(table.middle_s)) / SECONDS_PER_HOUR
    spread = float(np.ptp(np.percentile(heat, (5.0, 95.0))))
    if SLOWEST_DEG_PER_S < speed < FASTEST_DEG_PER_S and spread <= FASTEST_DEGC_PER_H * span_h:
        return []
    times_text = (
        f"By the times of `{name}` the table turns at {speed:.3g} deg/s and the gyro's temperature "
        f"changes by {spread:.3g} degC in {span_h:.3g} h: the times are not in seconds. The part "
        "of the gyro's bias follows them; convert the columns."
    )
    return [contradiction("t_before_s", times_text, file=name)]


def resolution_of(values: Array) -> float:
    """Return the largest decimal step, 1, 2 or 5, of which all values are multiples; else 0."""
    values = values[np.isfinite(values)]
    if len(np.unique(values)) < 2:
        return 0.0
    for power in range(2, -6, -1):
        for digit in (5.0, 2.0, 1.0):
            step = digit * 10.0**power
            if bool(np.all(np.abs(values / step - np.rint(values / step)) < 1e-3)):
                return float(step)
    return 0.0


def heading_resolution_deg(table: TurnTable) -> float:
    """Return the step in which the headings of a table come, zero where none is seen."""
    both = np.concatenate((table.attitude_before_deg[:, 0], table.attitude_after_deg[:, 0]))
    return resolution_of(both)


def _resolution(dataset: FogDataset, name: str, table: TurnTable) -> list[Flag]:
    """Return the flag of headings that are coarser than stated."""
    stated, resolution = dataset.heading_resolution_deg, heading_resolution_deg(table)
    if not stated or resolution <= COARSER * stated:
        return []
    steps_text = (
        f"The headings of `{name}` come in steps of {resolution:g} deg, the stated resolution is "
        f"{stated:g} deg: digits were lost. Export them with all digits, or state what is true."
    )
    return [contradiction("heading_resolution", steps_text, file=name)]


def _temperature_flags(dataset: FogDataset, name: str, table: TurnTable) -> list[Flag]:
    """Return the flags of temperatures that contradict the range, the chamber or one another."""
    texts: list[tuple[str, str]] = []
    heat, chamber = table.temperature_degC, table.chamber_degC
    there = np.isfinite(heat)
    if int(there.sum()) < TURNS_IN_A_ROW:
        return []
    low, high = np.percentile(heat[there], (2.0, 98.0))
    stated = dataset.temperature_range_degC
    if stated and (low < stated[0] - OUTSIDE_RANGE_DEGC or high > stated[1] + OUTSIDE_RANGE_DEGC):
        texts.append(
            (
                "temperature_range",
                f"go from {low:.1f} to {high:.1f} degC, the stated range from {stated[0]:g} to "
                f"{stated[1]:g} degC: another unit, another sign, or another log",
            )
        )
    jump = float(
        np.median(np.abs(table.temperature_after_degC - table.temperature_before_degC)[there])
    )
    if jump > AFTER_BEFORE_DEGC:
        texts.append(("gyro_temperature", f"change by {jump:.1f} degC within one turn: two units"))
    both = there & np.isfinite(chamber)
    if int(both.sum()) >= TURNS_IN_A_ROW:
        apart = np.abs(heat - chamber)[both]
        if float(np.percentile(apart, 90.0)) > FROM_CHAMBER_DEGC:
            text = f"are up to {apart.max():.0f} degC from the chamber's: another unit or sign"
            texts.append(("gyro_temperature", text))
        sides = (table.temperature_before_degC, table.temperature_after_degC)
        near = np.min([np.abs(side - chamber)[both] for side in sides], axis=0) < SAME_DEGC
        if float(near.mean()) > 0.9 and high - low > AFTER_BEFORE_DEGC:
            text = "are the chamber's: a gyro lags the chamber and warms itself"
            texts.append(("gyro_temperature", text))
    flags = [
        contradiction(
            statement,
            f"The gyro temperatures of `{name}` {text}. The curve stands at temperatures that may "
            "be wrong; correct the columns `gyro_temperature_…`.",
            file=name,
        )
        for statement, text in texts
    ]
    return flags + _thermometers(name, table)


def _thermometers(name: str, table: TurnTable) -> list[Flag]:
    """Return the flags of a gyro's thermometer that stands still, or leaves those of the others."""
    flags, courses = [], {}
    middle = np.unique(table.middle_s)
    heat = table.temperature_degC[np.isfinite(table.temperature_degC)]
    usual = float(np.ptp(heat)) / max(float(np.ptp(middle)), 1.0) if len(heat) else 0.0
    for axis in AXES:
        own = (table.axis == axis) & np.isfinite(table.temperature_degC)
        if int(own.sum()) < TURNS_IN_A_ROW:
            continue
        courses[axis] = np.interp(middle, table.middle_s[own], table.temperature_degC[own])
        pair = np.column_stack((table.temperature_before_degC, table.temperature_after_degC))[own]
        for first, count in zip(*equal_runs(pair), strict=True):
            last = first + count - 1
            sets = len(np.unique(table.set_number[own][first : last + 1]))
            span = np.ptp(table.middle_s[own][first : last + 1])
            chamber = table.chamber_degC[own][first : last + 1]
            fine = 0.0 < resolution_of(pair.ravel()) <= FINE_DEGC
            moved = usual * span * fine
            if bool(np.isfinite(chamber).all()):
                moved = float(np.ptp(chamber))
            if count >= TURNS_IN_A_ROW and sets >= FROZEN_SETS and moved > FROM_OTHERS_DEGC:
                flag = frozen(
                    f"The temperature of the {axis} gyro",
                    f"{count} turns of `{name}`, at {pair[first, 0]:g} degC",
                    "the thermometer",
                    "Leave these rows out.",
                    {"rows": int(count)},
                    axis,
                    though=", though the temperature changed",
                )
                flags.append(flag)
                break
    for axis, readings in courses.items():
        others = [other for key, other in courses.items() if key != axis]
        swings = [float(np.ptp(np.percentile(readings - other, (10.0, 90.0)))) for other in others]
        if swings and min(swings) > FROM_OTHERS_DEGC:
            apart_text = (
                f"The thermometer of the {axis} gyro in `{name}` leaves those of the others by "
                f"{min(swings):.1f} degC and more: another unit, a drift, or a loose sensor. The "
                "curve of this axis stands at wrong temperatures."
            )
            flags.append(contradiction("gyro_temperature", apart_text, axis, file=name))
    return flags
