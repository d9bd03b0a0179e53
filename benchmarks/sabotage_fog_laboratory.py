"""Further faults of logs of turns, as laboratories make them; see `sabotage.py`, `fog_logs.py`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from fog_logs import (
    AXES,
    Change,
    Log,
    Values,
    added,
    columns,
    curve_of,
    joined,
    log,
    part_of,
    rows_of,
    sensed,
    turned,
)
from fog_planting import (
    COARSE,
    FROZEN,
    LEFT_OUT,
    PROVED,
    SINGLE,
    STATEMENT,
    Maker,
    faults,
)
from sabotage import Array, Fault

THERE_AND_BACK: Maker = partial(log, there_and_back=True)
HYSTERESIS = frozenset({"hysteresis"})
REFUSED = frozenset({"refused"})
"""An import that ends without results."""


def some(share: float, change: Callable[[Array], Array], names: str) -> Change:
    """Return the change of columns whose names begin so, in a share of the rows."""

    def changed(log: Log, generator: np.random.Generator) -> Log:
        rows = generator.random(len(log.table)) < share
        new = {}
        for key, value in vars(log.table).items():
            if key.startswith(tuple(names.split())):
                new[key] = value.copy()
                new[key][rows] = change(value[rows])
        return replace(log, table=replace(log.table, **new))

    return changed


def while_warming(lag_degC: float) -> Change:
    """Return the change of thermometers that lag while the gyro warms alone."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        table = log.table
        warms = np.gradient(table.temperature_degC) > 0.0
        sides = (table.temperature_before_degC, table.temperature_after_degC)
        before, after = (
            np.asarray(np.round(side - lag_degC * warms, 3), np.float64) for side in sides
        )
        new = replace(table, temperature_before_degC=before, temperature_after_degC=after)
        return replace(log, table=new)

    return changed


def read_later(hours: float) -> Change:
    """Return the change of temperatures that are those of another time, by a clock that is off."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        table = log.table
        new = {}
        for side in ("before", "after"):
            heat, time_s = getattr(table, f"temperature_{side}_degC"), getattr(table, f"{side}_s")
            moved = heat.copy()
            for axis in AXES:
                own = table.axis == axis
                moved[own] = np.interp(time_s[own] + 3600.0 * hours, time_s[own], heat[own])
            new[f"temperature_{side}_degC"] = np.round(moved, 3)
        return replace(log, table=replace(table, **new))

    return changed


def twice(first: float, last: float, renumbered: bool) -> Change:
    """Return the change that has a part of the log's rows twice, the second time at its end."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        inside = (part_of(log) >= first) & (part_of(log) < last)
        rows = np.concatenate((np.arange(len(log.table)), np.flatnonzero(inside)))
        table = rows_of(log.table, rows)
        if renumbered:
            number = table.set_number.copy()
            number[len(log.table) :] += int(log.table.set_number.max()) + 1
            table = replace(table, set_number=number)
        return replace(log, table=table)

    return changed


def every_row_twice(log: Log, _: np.random.Generator) -> Log:
    """Return a log with each row written twice."""
    return replace(log, table=rows_of(log.table, np.repeat(np.arange(len(log.table)), 2)))


def first_ramp_again(log: Log, _: np.random.Generator) -> Log:
    """Return a log whose proof is the calibrating ramp once more."""
    return replace(log, verification=log.table)


def part_of_ramp_again(log: Log, _: np.random.Generator) -> Log:
    """Return a log a quarter of whose proof are turns of the calibrating ramp."""
    proof = log.verification
    assert proof is not None
    quarter = len(proof) // 4
    own = rows_of(proof, slice(quarter, len(proof)))
    return replace(log, verification=joined(rows_of(log.table, slice(0, quarter)), own))


def return_copied(log: Log, _: np.random.Generator) -> Log:
    """Return a log whose way back has the headings of its way out, in reverse order."""
    table, half = log.table, len(log.table) // 2
    new = {}
    for name in ("attitude_before_deg", "attitude_after_deg"):
        value: Values = getattr(table, name).copy()
        value[half:] = value[: len(value) - half]
        new[name] = value
    return replace(log, table=replace(table, **new))


def other_gyro(seed: int, first: float) -> Change:
    """Return the change to a log whose turns come of another gyro from a part of it on."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        table, error = log.table, np.zeros(len(log.table))
        for place, axis in enumerate(AXES):
            heat = table.temperature_degC
            off = curve_of(seed, place)(heat) - log.curves[axis](heat)
            error = np.where(table.axis == axis, off, error)
        error = error * (part_of(log) >= first) * table.commanded_deg / 360.0
        return turned(log, error)

    return changed


def clock_again(log: Log, _: np.random.Generator) -> Log:
    """Return a log whose clock begins again in the middle."""
    later = part_of(log) >= 0.5
    off_s = later * float(np.ptp(log.table.before_s)) * 0.5
    table = replace(
        log.table, before_s=log.table.before_s - off_s, after_s=log.table.after_s - off_s
    )
    return replace(log, table=table)


def fifth_sets(part: Values) -> Values:
    """Return which of some sets, one in five, a part of a log of 54 belongs to."""
    return np.asarray(np.rint(part * 53) % 5 == 2)


LABORATORY: tuple[Fault, ...] = (
    *faults(
        HYSTERESIS,
        ("thermometers that lag by 1 degC while warming", while_warming(1.0)),
        ("thermometers that lag by 0.5 degC while warming", while_warming(0.5)),
        kind=THERE_AND_BACK,
        detectable=True,
    ),
    *faults(
        HYSTERESIS | STATEMENT | FROZEN,
        ("thermometers an hour early, there and back", read_later(1.0)),
        ("thermometers two hours late, there and back", read_later(-2.0)),
        ("return with the headings of the way out", return_copied),
        kind=THERE_AND_BACK,
        detectable=True,
    ),
    *faults(
        STATEMENT,
        ("thermometers an hour early, proved", read_later(1.0)),
        ("thermometers that lag by 1 degC while warming, proved", while_warming(1.0)),
        ("bias known to be another, proved", sensed(lambda p: 12.0)),
        kind=PROVED,
        detectable=True,
    ),
    *faults(
        STATEMENT,
        ("proof is the calibrating ramp", first_ramp_again),
        ("a quarter of the proof is the calibrating ramp", part_of_ramp_again),
        kind=PROVED,
        detectable=True,
    ),
    *faults(
        LEFT_OUT,
        ("table 1e-4 off in a fifth of the log", sensed(lambda p: 100.0 * ((p > 0.4) & (p < 0.6)))),
        ("table 1e-4 off in one set of five", sensed(lambda p: 100.0 * fifth_sets(p))),
        ("table 2e-5 off from two thirds on", sensed(lambda p: 20.0 * (p > 0.67))),
        (
            "commands with the other sign in three sets",
            columns("commanded", np.negative, 0.4, 0.46),
        ),
        (
            "commands with the other sign in the last two sets",
            columns("commanded", np.negative, 0.97),
        ),
        ("commands with the other sign from the middle", columns("commanded", np.negative, 0.5)),
        ("another gyro from the middle", other_gyro(777, 0.5)),
        ("another gyro for the last sixth", other_gyro(778, 0.84)),
    ),
    *faults(
        LEFT_OUT | STATEMENT,
        (
            "table 1e-4 off in a fifth, single turns",
            sensed(lambda p: 100.0 * ((p > 0.4) & (p < 0.6))),
        ),
        (
            "commands with the other sign in three sets, single turns",
            columns("commanded", np.negative, 0.4, 0.46),
        ),
        ("bias steps by 1 deg/h, single turns", added(lambda log, _: 36.0 * (part_of(log) > 0.45))),
        (
            "bias of 0.5 deg/h for a tenth, single turns",
            added(lambda log, _: 18.0 * ((part_of(log) > 0.3) & (part_of(log) < 0.41))),
        ),
        ("another gyro from the middle, single turns", other_gyro(777, 0.5)),
        kind=SINGLE,
    ),
    *faults(
        STATEMENT | LEFT_OUT,
        ("earth's rate not taken off, single turns and a drive", added(lambda log, _: 350.0)),
        kind=partial(log, turns=(360,), driven=True),
        detectable=True,
    ),
    *faults(
        STATEMENT,
        (
            "a level's temperatures 10 degC high",
            columns("temperature", lambda t: t + 10.0, 0.5, 0.6),
        ),
        (
            "a level's temperatures those of an earlier one",
            columns("temperature", lambda t: t - 6.0, 0.7, 0.78),
        ),
        ("temperature before in degF", columns("temperature_before", lambda t: 1.8 * t + 32)),
        ("temperature after in degF", columns("temperature_after", lambda t: 1.8 * t + 32)),
        (
            "temperatures in degF from the middle",
            columns("temperature", lambda t: 1.8 * t + 32, 0.5),
        ),
        ("z in kelvin", columns("temperature", lambda t: t + 273.15, axes="z")),
        ("headings of x in radians", columns("attitude", np.radians, axes="x")),
        ("headings of y in gon", columns("attitude", lambda a: a / 0.9, axes="y")),
        detectable=True,
    ),
    *faults(
        STATEMENT | LEFT_OUT,
        ("one temperature of twenty written as 0", some(0.05, np.zeros_like, "temperature")),
        ("one heading of twenty written as 0", some(0.05, np.zeros_like, "attitude_after")),
        (
            "one heading of twenty half a turn off",
            some(0.05, lambda a: np.mod(a + 180.0, 360.0), "attitude_after"),
        ),
        (
            "headings rounded to whole degrees in one row of twenty",
            some(0.05, np.round, "attitude"),
        ),
    ),
    *faults(
        COARSE,
        ("temperatures of y to 1 degC", columns("temperature", np.round, axes="y")),
        ("temperatures to 1 degC, cut off", columns("temperature", np.floor)),
        detectable=True,
    ),
    *faults(
        REFUSED,
        ("each row twice", every_row_twice),
        ("a third of the rows twice", twice(0.3, 0.63, renumbered=False)),
        ("a third of the rows twice, as new sets", twice(0.3, 0.63, renumbered=True)),
        detectable=True,
    ),
    *faults(
        REFUSED,
        ("clock begins again in the middle", clock_again),
        detectable=True,
    ),
)
