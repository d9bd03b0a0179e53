"""Columns of turns that cannot be what their names say: units, rows, axes, thermometers, copies.

Headings some rows beside their turns leave errors that no curve and no bias follows. A gyro's
temperature has a smooth course in time, which readings of other turns do not have, since the time
from turn to turn is uneven.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scipy.ndimage import median_filter

from procedures.common.constants import FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.common.frozen import COPIED_ROWS, TURNS_IN_A_ROW, equal_runs, frozen_flag, no_chance
from procedures.estimation.channel import smallest_step
from procedures.estimation.orthogonal import MAD_TO_SIGMA
from procedures.estimation.plausibility import Bounds, implausible
from procedures.estimation.readings import Reading, Remainder, Suit, shifted, suiting
from station.findings import Flag, contradiction

from .curve import chebyshev_columns
from .dataset import (
    AXES,
    PPM,
    Array,
    FogDataset,
    Mask,
    TurnTable,
    rotation_to_navigation,
    set_means,
    turn_errors_deg,
)

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
FEWEST_TURNS = 20
CLIPPED = 5.0
"""Times the usual residual: as much counts a wild one."""
USUAL_ORDER = 4
MIN_LEFT_PPM, MIN_JAGGED_DEGC = 10.0, 0.02
"""Rms of turns, and of a gyro's temperature, that need no other reading."""
MAX_ROWS = 12
"""Beside their own: how far columns are looked for."""
UPRIGHT_DEG = 5.0
"""From the vertical: an axis that points up."""
COARSER = 2.5
"""Than stated: steps of the headings."""
COPIED_BEYOND = 3.0
AROUND = 9
WILD_DEVIATIONS, WILD_DEGC = 8.0, 5.0
MIN_STEP_DEGC, STEP_SPREADS, STEP_RESOLUTIONS = 0.5, 12.0, 3.0
FEWEST_SETS = 10
FINE_DEGC = 0.05
"""Of a thermometer: one that is coarser stands still at a soak, too."""
FROZEN_SETS, MOVED_DEGC = 3, 4.0
"""A thermometer that is equal for so long while the temperature moves by so much has stopped."""
MAX_APART_DEGC = 4.0
"""Of the thermometers of two gyros in one housing: how far their difference goes up and down."""
SAME_DEGC, SAME_PART, MIN_SPAN_DEGC = 0.011, 0.9, 5.0
"""Of gyro and chamber: of so many turns, over so much, nobody's thermometers agree so well."""
SIDES = ("before", "after")
CORRECT = "The curve stands at temperatures that may be wrong; correct `gyro_temperature_…`."


def table_flags(dataset: FogDataset) -> list[Flag]:
    """Return the flags of columns that cannot be what their names say, whatever the curve."""
    flags: list[Flag] = []
    for name, table in (("turns", dataset.turns), ("verification", dataset.verification)):
        if table is not None and len(table):
            for check in (_headings, _axes, _limits, _thermometers, _repeats, _rows_late):
                flags += check(dataset, name, table)
    proof = dataset.verification
    copied = 0 if proof is None else int(copied_turns(proof, dataset.turns).sum())
    if proof is not None and copied:
        same_text = (
            f"{copied} of {len(proof)} turns of `verification` have exactly the readings of turns "
            "that the curve is fitted to: they prove nothing and are left out. Verify by another "
            "ramp."
        )
        flags.append(contradiction("verification", same_text, rows=copied))
    return flags


def _left_by_curves(dataset: FogDataset) -> Callable[[TurnTable], Remainder | None]:
    """Return what tells what a curve and a bias for each axis leave of turns, in ppm squared."""

    def left(table: TurnTable) -> Remainder | None:
        error = turn_errors_deg(table, dataset.turn_sense, dataset.full_attitude)
        heat, squares, freedom = table.temperature_degC, 0.0, 0
        for axis in AXES:
            own = (table.axis == axis) & np.isfinite(error) & np.isfinite(heat)
            order = min(USUAL_ORDER, len(np.unique(heat[own])) - 2)
            if int(own.sum()) < FEWEST_TURNS or order < 0:
                continue
            domain = float(heat[own].min()), float(heat[own].max())
            scale = chebyshev_columns(heat[own], domain, order)
            columns = scale * table.commanded_deg[own, None]
            if len(np.unique(np.rint(table.commanded_deg[own]))) > 1:
                columns = np.column_stack((columns, table.duration_s[own]))
            ppm = error[own] / FULL_TURN_DEG * PPM
            # Turns of no angle, or of no time, have columns that say nothing.
            sizes, _, rank, _ = np.linalg.lstsq(columns, ppm, rcond=None)
            squares += _clipped_squares(ppm - columns @ sizes)
            freedom += len(ppm) - int(rank)
        return Remainder(squares, freedom) if freedom else None

    return left


def _clipped_squares(residual: Array) -> float:
    size = np.abs(residual)
    usual = float(np.median(size)) if len(size) else 0.0
    return float(np.sum(np.minimum(size, CLIPPED * usual) ** 2))


def _left_by_course(table: TurnTable) -> Remainder | None:
    """Return how far temperatures are from the line between their neighbours, in degC squared."""
    squares, rows = 0.0, 0
    for side in SIDES:
        off = [np.zeros(0)]
        heat: Array = getattr(table, f"temperature_{side}_degC")
        for axis in AXES:
            there = (table.axis == axis) & np.isfinite(heat)
            t, values = getattr(table, f"{side}_s")[there], heat[there]
            part = (t[1:-1] - t[:-2]) / np.maximum(t[2:] - t[:-2], 1e-9)
            between = values[:-2] + part * (values[2:] - values[:-2])
            # Of white noise alone a row is off by as much, wherever it stands between the others.
            off.append((values[1:-1] - between) / np.sqrt(1.0 + part**2 + (1.0 - part) ** 2))
        every = np.concatenate(off)
        squares, rows = squares + _clipped_squares(every), rows + len(every)
    return Remainder(squares, rows) if rows else None


def _readable(
    table: TurnTable,
    kinds: Sequence[Sequence[Reading[TurnTable]]],
    left: Callable[[TurnTable], Remainder | None],
    least: float,
    better: float,
) -> list[Suit[TurnTable]]:
    """Return the readings of the first kind that suits turns which leave more than `least` rms."""
    stated = left(table)
    if stated is None or stated.squares <= least**2 * stated.freedom:
        return []
    tried = (suiting(table, [kind], left, stated=stated, better=better) for kind in kinds)
    return next((suits for suits in tried if suits), [])


def unit_of_headings(table: TurnTable, full_attitude: bool) -> str | None:
    """Return the unit of the headings where they are no degrees, else None.

    Headings that may be any fill one turn of their unit, from zero or about it, and go nowhere
    beyond; degrees, minutes and seconds have no fraction above 0.6. With pitch and roll: radians
    where those of axes that point up lie at pi/2.
    """
    angles = np.concatenate((table.attitude_before_deg, table.attitude_after_deg))
    headings = angles[:, 0][np.isfinite(angles[:, 0])]
    if len(headings) < FEWEST_TURNS:
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
    if sixty and filled and len(headings) > 2 * FEWEST_TURNS:
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
        if unit or (whole and (not known or len(own[axis]) < FEWEST_TURNS))
    }


def _headings(dataset: FogDataset, name: str, table: TurnTable) -> Iterator[Flag]:
    """Yield the flags of headings in another unit, or coarser than stated."""
    units = units_of_headings(table, dataset.full_attitude)
    for unit in sorted(set(units.values())):
        axes = [axis for axis, own in units.items() if own == unit]
        unit_text = (
            f"The headings of `{name}` about {', '.join(axes)} look like {unit}: they fill one "
            "turn of that unit and no more. The columns are in degrees; nothing is reported from "
            "them. Convert them."
        )
        yield contradiction("heading_deg", unit_text, file=name, axes=axes)
    if stated := dataset.heading_resolution_deg:
        bounds = Bounds(
            "heading_resolution",
            f"The step of the headings of `{name}`",
            0.0,
            COARSER * stated,
            "deg",
            "Digits were lost: export them with all digits, or state what is true.",
        )
        yield from implausible(heading_resolution_deg(table), bounds)


def _axes(dataset: FogDataset, name: str, table: TurnTable) -> Iterator[Flag]:
    named = set(table.axis[~upright(table, dataset.full_attitude)].tolist())
    if wrong := sorted(named - set(units_of_headings(table, dataset.full_attitude))):
        axis_text = (
            f"In `{name}` the attitude does not have the axis up that the row names "
            f"({', '.join(wrong)}): an axis called by another's name, mounted upside down, or "
            "pitch and roll exchanged. Such turns are left out. Correct the column `axis`."
        )
        yield contradiction("axis", axis_text, axes=wrong, file=name)


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


def heading_resolution_deg(table: TurnTable) -> float:
    """Return the step in which the headings of a table come, zero where none is seen.

    The largest decimal one, 1, 2 or 5, of which all are multiples: few headings, spread over a
    circle, lie many steps apart.
    """
    headings = np.concatenate((table.attitude_before_deg[:, 0], table.attitude_after_deg[:, 0]))
    headings = headings[np.isfinite(headings)]
    if not len(headings):
        return 0.0
    steps = (digit * 10.0**power for power in range(2, -6, -1) for digit in (5.0, 2.0, 1.0))
    for step in steps:
        count = np.rint(headings / step)
        if np.ptp(count) > 0.0 and bool(np.all(np.abs(headings / step - count) < 1e-3)):
            return float(step)
    return 0.0


def _limits(dataset: FogDataset, name: str, table: TurnTable) -> Iterator[Flag]:
    """Yield the flags of times and temperatures beyond what table, gyro and chamber can have."""
    heat, chamber = table.temperature_degC, table.chamber_degC
    there, turning = np.isfinite(heat), np.abs(table.commanded_deg) > 0.0
    if int(there.sum()) < TURNS_IN_A_ROW:
        return
    low, high = np.percentile(heat[there], (2.0, 98.0))
    within = np.abs(table.temperature_after_degC - table.temperature_before_degC)[there]
    both = there & np.isfinite(chamber)
    measured: list[tuple[str, str, float, float, float, str]] = [
        ("gyro_temperature", "The change within a turn", float(np.median(within)), 0, 5, "degC")
    ]
    if dataset.temperature_range_degC is not None:
        cold, hot = dataset.temperature_range_degC
        measured += [
            ("temperature_range", f"The {end} gyro temperature", value, cold - 15, hot + 15, "degC")
            for end, value in (("lowest", low), ("highest", high))
        ]
    if int(both.sum()) >= TURNS_IN_A_ROW:
        apart = float(np.percentile(np.abs(heat - chamber)[both], 90.0))
        measured.append(
            ("gyro_temperature", "What lies between gyro and chamber", apart, 0, 40, "degC")
        )
    if int(turning.sum()) >= FEWEST_TURNS:
        speed = np.median(np.abs(table.commanded_deg[turning]) / table.duration_s[turning])
        span_h = float(np.ptp(table.middle_s)) / SECONDS_PER_HOUR
        slope = np.ptp(np.percentile(heat[there], (5.0, 95.0))) / max(span_h, 1e-9)
        measured += [
            ("t_before_s", "The rate of the turns", speed, 0.1, 1000, "deg/s"),
            ("t_before_s", "The temperature's rate", slope, 0, 200, "degC/h"),
        ]
    for statement, what, value, least, most, unit in measured:
        look = CORRECT if unit == "degC" else "Times are in s; convert `t_before_s`, `t_after_s`."
        bounds = Bounds(statement, f"{what} of `{name}`", float(least), float(most), unit, look)
        yield from implausible(float(value), bounds)
    sides = (table.temperature_before_degC, table.temperature_after_degC)
    near = [np.abs(side - chamber)[both] < SAME_DEGC for side in sides]
    alike = int(both.sum()) >= TURNS_IN_A_ROW and np.any(near, axis=0).mean() > SAME_PART
    if alike and high - low > MIN_SPAN_DEGC:
        same_text = (
            f"The gyro temperatures of `{name}` are the chamber's: a gyro lags the chamber and "
            f"warms itself. {CORRECT}"
        )
        yield contradiction("gyro_temperature", same_text, file=name)


def _thermometers(dataset: FogDataset, name: str, table: TurnTable) -> Iterator[Flag]:
    """Yield the flags of a gyro's thermometer that stands still, or leaves those of the others."""
    courses = {}
    middle = np.unique(table.middle_s)
    heat = table.temperature_degC[np.isfinite(table.temperature_degC)]
    usual = float(np.ptp(heat)) / max(float(np.ptp(middle)), 1.0) if len(heat) else 0.0
    for axis in AXES:
        turns = table.of((table.axis == axis) & np.isfinite(table.temperature_degC))
        if len(turns) < TURNS_IN_A_ROW:
            continue
        courses[axis] = np.interp(middle, turns.middle_s, turns.temperature_degC)
        pair = np.column_stack((turns.temperature_before_degC, turns.temperature_after_degC))
        fine = smallest_step(pair) <= FINE_DEGC
        for first, count in zip(*equal_runs(pair), strict=True):
            run = turns.of(slice(first, first + count))
            moved = usual * float(np.ptp(run.middle_s)) * fine
            if bool(np.isfinite(run.chamber_degC).all()):
                moved = float(np.ptp(run.chamber_degC))
            sets = len(np.unique(run.set_number))
            if count >= TURNS_IN_A_ROW and sets >= FROZEN_SETS and moved > MOVED_DEGC:
                yield frozen_flag(
                    f"The temperature of the {axis} gyro",
                    f"{count} turns of `{name}`, at {pair[first, 0]:g} degC, though the "
                    "temperature changed",
                    "the thermometer",
                    "Leave these rows out.",
                    {"rows": int(count)},
                    axis,
                )
                break
    for axis, followed in courses.items():
        others = [other for key, other in courses.items() if key != axis]
        swings = [float(np.ptp(np.percentile(followed - other, (10.0, 90.0)))) for other in others]
        if swings and min(swings) > MAX_APART_DEGC:
            apart_text = (
                f"The thermometer of the {axis} gyro in `{name}` leaves those of the others by "
                f"{min(swings):.1f} degC and more: another unit, a drift, or a loose sensor. The "
                "curve of this axis stands at wrong temperatures."
            )
            yield contradiction("gyro_temperature", apart_text, axis, file=name)


def _rows_late(dataset: FogDataset, name: str, table: TurnTable) -> Iterator[Flag]:
    """Yield the flags of columns in the rows of other turns, and of thermometers that step."""
    if len(table) < 2 * MAX_ROWS:
        return
    heats = {side: (f"temperature_{side}_degC",) for side in SIDES}
    columns = {
        "heading_deg": {"headings": tuple(f"attitude_{side}_deg" for side in SIDES)},
        "gyro_temperature": {
            "temperatures": tuple(f"temperature_{side}_degC" for side in SIDES),
            **{f"temperatures {side}": names for side, names in heats.items()},
        },
    }
    lefts: dict[str, tuple[Callable[[TurnTable], Remainder | None], float, float, str]] = {
        "heading_deg": (_left_by_curves(dataset), MIN_LEFT_PPM, 0.2, "turns of both senses agree"),
        "gyro_temperature": (_left_by_course, MIN_JAGGED_DEGC, 0.5, "their course is smooth"),
    }
    late = False
    for statement, of in columns.items():
        # Whole sets or pairs more or less suit as well: the fewest rows are named.
        kinds = [
            [
                Reading(what, shifted(names, sign * rows), statement, {"rows": rows})
                for what, names in of.items()
                for sign in (1, -1)
            ]
            for rows in range(1, MAX_ROWS + 1)
        ]
        left, least, better, then = lefts[statement]
        if suits := _readable(table, kinds, left, least, better):
            reading = suits[0].reading
            rows_text = (
                f"In `{name}` the {reading.what} do not stand in the rows of their turns: "
                f"{reading.details['rows']} or more rows away {then}. The curve is that of other "
                "turns; put the columns into their rows."
            )
            yield reading.flag(rows_text, file=name)
            late |= statement == "gyro_temperature"
    if not late:
        yield from _steps(name, table)


def _steps(name: str, table: TurnTable) -> Iterator[Flag]:
    """Yield the flag of a gyro whose temperature steps between two sets and nowhere else.

    A gyro follows the chamber within its time constant, longer than the way from set to set: its
    temperature has no rate that only one interval has.
    """
    for axis in AXES:
        own = (table.axis == axis) & np.isfinite(table.temperature_degC)
        numbers = np.unique(table.set_number[own])
        if len(numbers) < FEWEST_SETS:
            continue
        middle_s, heat = set_means(
            table.set_number[own], table.middle_s[own], table.temperature_degC[own]
        )
        order = np.argsort(middle_s)
        interval_s = np.maximum(np.diff(middle_s[order]), 1e-9)
        usual_s = float(np.median(interval_s))
        rate = np.diff(heat[order]) / interval_s
        before, after = rate[1:-1] - rate[:-2], rate[1:-1] - rate[2:]
        alone = np.minimum(np.abs(before), np.abs(after)) * interval_s[1:-1]
        alone[(before * after <= 0.0) | (interval_s[1:-1] >= 1.5 * usual_s)] = 0.0
        spread = MAD_TO_SIGMA * float(np.median(np.abs(before))) * usual_s
        step_degC = STEP_RESOLUTIONS * smallest_step(table.temperature_degC[own])
        worst = int(np.argmax(alone))
        if alone[worst] > max(MIN_STEP_DEGC, STEP_SPREADS * spread, step_degC):
            size = 0.5 * float(before[worst] + after[worst]) * float(interval_s[worst + 1])
            step_text = (
                f"The temperature of the {axis} gyro in `{name}` steps by {size:+.2g} degC before "
                f"set {int(numbers[order][worst + 2])} and goes on at its rate: no gyro does, its "
                "thermometer or its reading stepped. Turns on one side of the step stand at wrong "
                "temperatures; leave them out."
            )
            yield contradiction("gyro_temperature", step_text, axis, file=name, step_degC=size)


def copied_turns(table: TurnTable, other: TurnTable) -> Mask:
    """Return which rows of a table have the readings of a row of another, where it is no chance."""
    own, others = _angles(table), _angles(other)
    known = {row.tobytes() for row in others}
    copied = np.array([row.tobytes() in known for row in own], dtype=bool)
    both = np.concatenate((own, others))
    return copied & (int(copied.sum()) > _most_by_chance(both))


def _angles(table: TurnTable) -> Array:
    """Return the attitudes before and after, (rows, 6), nothing where there is none."""
    angles = np.column_stack((table.attitude_before_deg, table.attitude_after_deg))
    return np.where(np.isfinite(angles), angles, 0.0) + 0.0


def _most_by_chance(angles: Array) -> float:
    """Return how many rows seldom have the readings of another: coarse ones repeat by chance."""

    def alike(values: Array) -> float:
        count = np.unique(values, axis=0, return_counts=True)[1]
        return float(np.sum(count * (count - 1)) / 2)

    rows = len(angles)
    change = np.round(angles[:, 3:] - angles[:, :3], 7)
    chance = alike(angles[:, :3]) * alike(change) / max(0.5 * rows * (rows - 1), 1.0)
    return COPIED_ROWS + COPIED_BEYOND * chance


def _repeats(dataset: FogDataset, name: str, table: TurnTable) -> Iterator[Flag]:
    """Yield the flag of readings that repeat: a navigator that stood still, or copied rows."""
    angles = _angles(table)
    rows = len(angles)
    if rows < TURNS_IN_A_ROW:
        return
    repeated = rows - len(np.unique(angles, axis=0))
    same = np.concatenate(([False], np.all(angles[1:] == angles[:-1], axis=1)))
    change = np.round(angles[:, 3:] - angles[:, :3], 7)
    unmoved = np.all(change == 0.0, axis=1) & (table.commanded_deg != 0.0)
    if no_chance(unmoved):
        reading = "The attitude before the turn"
        extent = f"{int(unmoved.sum())} of {rows} turns of `{name}`, though the table turned"
    elif no_chance(same) or repeated > _most_by_chance(angles):
        reading = "The attitude of another turn"
        extent = f"{repeated} of {rows} turns of `{name}`"
    else:
        return
    yield frozen_flag(
        reading,
        extent,
        "the navigator",
        "Leave these rows out.",
        {"rows": repeated, "file": name},
    )


def believable_temperatures(table: TurnTable) -> Mask:
    """Return which rows' temperatures can be, (rows,): a wild one would bend all columns.

    Held against the median of the rows around, and before against after.
    """
    believable = np.isfinite(table.temperature_degC)
    if int(believable.sum()) >= AROUND:
        heat = table.temperature_degC[believable]
        padded = np.pad(heat, AROUND // 2, mode="reflect", reflect_type="odd")
        off = np.abs(heat - median_filter(padded, AROUND)[AROUND // 2 : -(AROUND // 2)])
        jump = np.abs(table.temperature_after_degC - table.temperature_before_degC)[believable]
        believable[believable] = (off <= _reach(off)) & (jump <= _reach(jump))
    return believable


def _reach(deviations: Array) -> float:
    return max(WILD_DEGC, WILD_DEVIATIONS * MAD_TO_SIGMA * float(np.median(deviations)))
