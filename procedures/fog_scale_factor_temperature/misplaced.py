"""Columns that stand some rows beside the turns they belong to, and thermometers that step.

A gyro's temperature has a smooth course in time. Readings that stand in the rows of later turns
make it jagged, since the time from turn to turn is uneven; in the rows of their own they do not.
Headings that stand in the rows of later turns give each turn the error of another one: what a turn
one way and a turn back have in common is then no longer the gyro's bias but differences of curves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from station.findings import Flag, contradiction

from .dataset import AXES, PPM, Array, FogDataset, Mask, TurnTable, turn_errors_deg

MAX_ROWS = 12
"""Beside their own: how far columns are looked for."""
FEWEST = 24
SMOOTHER = 0.5
"""Times as jagged as in the stated rows, at most, that readings are in the rows of their own."""
MIN_JAGGED_DEGC = 0.02
ALIKE = 1.5
LESS_COMMON = 0.2
"""Of what the turns of both senses share as stated, where the headings are in their rows."""
MIN_COMMON_PPM = 10.0
MIN_STEP_DEGC, STEP_SPREADS, STEP_RESOLUTIONS = 0.5, 12.0, 3.0
FEWEST_SETS = 10
SIDES = ("before", "after")


def misplaced_flags(dataset: FogDataset) -> list[Flag]:
    """Return the flags of columns in the wrong rows, and of thermometers that step."""
    flags = []
    for name, table in (("turns", dataset.turns), ("verification", dataset.verification)):
        if table is None or len(table) < FEWEST:
            continue
        late = {side: _late_temperatures(table, side) for side in SIDES}
        for rows in sorted({rows for rows in late.values() if rows}):
            sides = [f"`gyro_temperature_{side}_degC`" for side in SIDES if late[side] == rows]
            warm_text = (
                f"In `{name}` {' and '.join(sides)} {'does' if len(sides) == 1 else 'do'} not "
                f"stand in the rows of their turns: as stated the temperatures jump from turn to "
                f"turn, {_rows(rows)} away they have a smooth course in time. The curve stands at "
                "the temperatures of other turns; put the columns into their rows."
            )
            flags.append(contradiction("gyro_temperature", warm_text, file=name, rows=rows))
        rows = _late_headings(table, dataset)
        if rows:
            turned_text = (
                f"In `{name}` the headings do not stand in the rows of their turns: as stated "
                "turns of both senses differ by far more than a bias makes, "
                f"{_rows(rows)} away they agree. Each turn has the error of another one; put the "
                "columns into their rows."
            )
            flags.append(contradiction("heading_deg", turned_text, file=name, rows=rows))
        flags += [] if any(late.values()) else _steps(name, table)
    return flags


def _rows(rows: int) -> str:
    return f"{rows} row{'s' if rows > 1 else ''}"


def _placed(count: int, rows: int) -> tuple[slice, slice]:
    """Return the rows that readings belong to, and the rows in which they stand so much later."""
    if rows >= 0:
        return slice(0, count - rows), slice(rows, count)
    return slice(-rows, count), slice(0, count + rows)


def _late_temperatures(table: TurnTable, side: str) -> int:
    """Return how many rows away temperatures fit at least, 0 where they may stand right."""
    heat: Array = getattr(table, f"temperature_{side}_degC")
    time_s: Array = getattr(table, f"{side}_s")
    jagged = {
        rows: _jagged(table.axis, time_s, heat, rows) for rows in range(-MAX_ROWS, MAX_ROWS + 1)
    }
    best = min(jagged.values())
    if best >= SMOOTHER * jagged[0] or jagged[0] < MIN_JAGGED_DEGC:
        return 0
    # Whole sets or pairs more or less are as smooth, and some rows late as so many early.
    return min(abs(rows) for rows in jagged if jagged[rows] <= ALIKE * best)


def _jagged(axis: np.ndarray, time_s: Array, heat: Array, rows: int) -> float:
    """Return how far readings of a gyro usually are from the line between their neighbours."""
    own, stated = _placed(len(heat), rows)
    off = []
    for other in AXES:
        there = (axis[own] == other) & np.isfinite(heat[stated])
        t, values = time_s[own][there], heat[stated][there]
        if len(t) < 3:
            continue
        part = (t[1:-1] - t[:-2]) / np.maximum(t[2:] - t[:-2], 1e-9)
        between = values[:-2] + part * (values[2:] - values[:-2])
        # Of white noise alone a row is off by as much, wherever it stands between the others.
        off.append(np.abs(values[1:-1] - between) / np.sqrt(1.0 + part**2 + (1.0 - part) ** 2))
    return float(np.sqrt(np.mean(np.minimum(np.concatenate(off), _wild(off)) ** 2))) if off else 0.0


def _wild(off: list[Array]) -> float:
    """Return what a wild reading counts as."""
    return 5.0 * float(np.median(np.concatenate(off))) + 1e-12


def _late_headings(table: TurnTable, dataset: FogDataset) -> int:
    """Return how many rows away headings fit at least, 0 where they may stand right."""
    common = {}
    for rows in range(-MAX_ROWS, MAX_ROWS + 1):
        own, stated = _placed(len(table), rows)
        moved = replace(
            table.of(own),
            attitude_before_deg=table.attitude_before_deg[stated],
            attitude_after_deg=table.attitude_after_deg[stated],
        )
        shared = _common_ppm(moved, dataset)
        if shared is not None:
            common[rows] = shared
    if 0 not in common:
        return 0
    if common[0] <= MIN_COMMON_PPM:
        return 0
    near = (abs(rows) for rows, shared in common.items() if shared < LESS_COMMON * common[0])
    return min(near, default=0)


def _common_ppm(table: TurnTable, dataset: FogDataset) -> float | None:
    """Return what neighbouring turns of both senses of an axis usually share; None without them."""
    error = turn_errors_deg(table, dataset.turn_sense, dataset.full_attitude) / 360.0 * PPM
    shared = []
    for axis in AXES:
        own: Mask = (table.axis == axis) & np.isfinite(error)
        turns, numbers = table.commanded_deg[own], table.set_number[own]
        back = (turns[1:] == -turns[:-1]) & (turns[1:] != 0.0) & (numbers[1:] == numbers[:-1])
        shared.append(0.5 * np.abs(error[own][1:] + error[own][:-1])[back])
    together = np.concatenate(shared)
    return float(np.sqrt(np.mean(together**2))) if len(together) >= FEWEST // 2 else None


def _steps(name: str, table: TurnTable) -> Iterator[Flag]:
    """Yield the flag of a gyro whose temperature steps between two sets and nowhere else.

    A gyro follows the chamber within its time constant, longer than the way from set to set: its
    temperature has no rate that only one interval has.
    """
    for axis in AXES:
        own = (table.axis == axis) & np.isfinite(table.temperature_degC)
        numbers, place = np.unique(table.set_number[own], return_inverse=True)
        if len(numbers) < FEWEST_SETS:
            continue
        count = np.bincount(place)
        middle_s = np.bincount(place, table.middle_s[own]) / count
        heat = np.bincount(place, table.temperature_degC[own]) / count
        order = np.argsort(middle_s)
        interval_s = np.diff(middle_s[order])
        usual_s = float(np.median(interval_s))
        rate = np.diff(heat[order]) / np.maximum(interval_s, 1e-9)
        if usual_s <= 0.0:
            continue
        before, after = rate[1:-1] - rate[:-2], rate[1:-1] - rate[2:]
        alone = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
        beyond = alone * interval_s[1:-1]
        beyond = np.where(interval_s[1:-1] < 1.5 * usual_s, beyond, 0.0)
        values = np.unique(table.temperature_degC[own])
        spread = 1.4826 * float(np.median(np.abs(before))) * usual_s
        resolution = float(np.min(np.diff(values), initial=np.inf))
        resolution = resolution if np.isfinite(resolution) else 0.0
        least = max(MIN_STEP_DEGC, STEP_SPREADS * spread, STEP_RESOLUTIONS * resolution)
        worst = int(np.argmax(beyond))
        if beyond[worst] <= least:
            continue
        size = 0.5 * float(before[worst] + after[worst]) * float(interval_s[worst + 1])
        number = int(numbers[order][worst + 2])
        step_text = (
            f"The temperature of the {axis} gyro in `{name}` steps by {size:+.2g} degC before set "
            f"{number} and goes on at its rate: no gyro does, its thermometer or its reading "
            "stepped. Turns on one side of the step stand at wrong temperatures; leave them out."
        )
        yield contradiction("gyro_temperature", step_text, axis, file=name, step_degC=size)
