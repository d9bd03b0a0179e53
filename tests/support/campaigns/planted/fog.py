"""Faults of logs of turns over temperature; the logs themselves are in `fog_logs.py`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from fog_records import CURVES, NOISE_DEG, only, quartic, record
from simulated_drive import drive_csv, simulated_drive

from campaigns.planted.fog_logs import (
    AXES,
    COARSE,
    DRIVEN,
    FROZEN,
    FULL,
    LEFT_OUT,
    NOTHING,
    PAIRS,
    PROVED,
    SHAPE,
    SINGLE,
    STATED,
    STATEMENT,
    Change,
    Log,
    Maker,
    Shape,
    Values,
    added,
    bump,
    columns,
    csv,
    curve_of,
    faults,
    joined,
    kink,
    log,
    made,
    minutes,
    noisy,
    part_of,
    rows_of,
    sensed,
    swapped,
    turned,
)
from campaigns.planted.judging import (
    REFUSED,
    Array,
    Fault,
    Held,
    Made,
    Row,
    Written,
    but,
    example,
    of_fault,
    refusals,
    row,
)
from procedures.fog_scale_factor_temperature.analysis import analyse
from procedures.fog_scale_factor_temperature.dataset import FogDataset
from procedures.fog_scale_factor_temperature.evaluate import to_findings
from station.findings import Findings

THERE_AND_BACK: Maker = partial(log, there_and_back=True)
HYSTERESIS = frozenset({"hysteresis"})


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


# fmt: off
LABORATORY: tuple[Fault, ...] = (
    *faults(HYSTERESIS, ("thermometers that lag by 1 degC while warming", while_warming(1.0)),
        ("thermometers that lag by 0.5 degC while warming", while_warming(0.5)),
        kind=THERE_AND_BACK, detectable=True),
    *faults(HYSTERESIS | STATEMENT | FROZEN,
        ("thermometers an hour early, there and back", read_later(1.0)),
        ("thermometers two hours late, there and back", read_later(-2.0)),
        ("return with the headings of the way out", return_copied), kind=THERE_AND_BACK,
        detectable=True),
    *faults(STATEMENT, ("thermometers an hour early, proved", read_later(1.0)),
        ("thermometers that lag by 1 degC while warming, proved", while_warming(1.0)),
        ("bias known to be another, proved", sensed(lambda p: 12.0)), kind=PROVED, detectable=True),
    *faults(STATEMENT, ("proof is the calibrating ramp", first_ramp_again),
        ("a quarter of the proof is the calibrating ramp", part_of_ramp_again), kind=PROVED,
        detectable=True),
    *faults(LEFT_OUT, ("table 1e-4 off in a fifth of the log",
        sensed(lambda p: 100.0 * ((p > 0.4) & (p < 0.6)))),
        ("table 1e-4 off in one set of five", sensed(lambda p: 100.0 * fifth_sets(p))),
        ("table 2e-5 off from two thirds on", sensed(lambda p: 20.0 * (p > 0.67))),
        ("commands with the other sign in three sets",
        columns("commanded", np.negative, 0.4, 0.46)),
        ("commands with the other sign in the last two sets",
        columns("commanded", np.negative, 0.97)),
        ("commands with the other sign from the middle", columns("commanded", np.negative, 0.5)),
        ("another gyro from the middle", other_gyro(777, 0.5)),
        ("another gyro for the last sixth", other_gyro(778, 0.84))),
    *faults(LEFT_OUT | STATEMENT, ("table 1e-4 off in a fifth, single turns",
        sensed(lambda p: 100.0 * ((p > 0.4) & (p < 0.6)))),
        ("commands with the other sign in three sets, single turns",
        columns("commanded", np.negative, 0.4, 0.46)), ("bias steps by 1 deg/h, single turns",
        added(lambda log, _: 36.0 * (part_of(log) > 0.45))),
        ("bias of 0.5 deg/h for a tenth, single turns",
        added(lambda log, _: 18.0 * ((part_of(log) > 0.3) & (part_of(log) < 0.41)))),
        ("another gyro from the middle, single turns", other_gyro(777, 0.5)), kind=SINGLE),
    *faults(STATEMENT | LEFT_OUT,
        ("earth's rate not taken off, single turns and a drive", added(lambda log, _: 350.0)),
        kind=partial(log, turns=(360,), driven=True), detectable=True),
    *faults(STATEMENT, ("a level's temperatures 10 degC high",
        columns("temperature", lambda t: t + 10.0, 0.5, 0.6)),
        ("a level's temperatures those of an earlier one",
        columns("temperature", lambda t: t - 6.0, 0.7, 0.78)),
        ("temperature before in degF", columns("temperature_before", lambda t: 1.8 * t + 32)),
        ("temperature after in degF", columns("temperature_after", lambda t: 1.8 * t + 32)),
        ("temperatures in degF from the middle",
        columns("temperature", lambda t: 1.8 * t + 32, 0.5)),
        ("z in kelvin", columns("temperature", lambda t: t + 273.15, axes="z")),
        ("headings of x in radians", columns("attitude", np.radians, axes="x")),
        ("headings of y in gon", columns("attitude", lambda a: a / 0.9, axes="y")),
        detectable=True),
    *faults(STATEMENT | LEFT_OUT,
        ("one temperature of twenty written as 0", some(0.05, np.zeros_like, "temperature")),
        ("one heading of twenty written as 0", some(0.05, np.zeros_like, "attitude_after")),
        ("one heading of twenty half a turn off",
        some(0.05, lambda a: np.mod(a + 180.0, 360.0), "attitude_after")),
        ("headings rounded to whole degrees in one row of twenty",
        some(0.05, np.round, "attitude"))),
    *faults(COARSE, ("temperatures of y to 1 degC", columns("temperature", np.round, axes="y")),
        ("temperatures to 1 degC, cut off", columns("temperature", np.floor)), detectable=True),
    *faults(frozenset({REFUSED}), ("each row twice", every_row_twice),
        ("a third of the rows twice", twice(0.3, 0.63, renumbered=False)),
        ("a third of the rows twice, as new sets", twice(0.3, 0.63, renumbered=True)),
        detectable=True),
    *faults(frozenset({REFUSED}), ("clock begins again in the middle", clock_again),
        detectable=True),
)
# fmt: on


KINDS: tuple[Maker, ...] = (
    PAIRS,
    SINGLE,
    PROVED,
    FULL,
    partial(log, turns=(360, 0)),
    partial(log, turns=(360, -360, -360, 360)),
    partial(log, resolution_deg=0.01),
    partial(log, driven=True, proved=True),
    partial(log, noise=10.0, bias=0.5, walk=0.1),
    partial(log, sets=24),
    partial(log, turns=(360,), sets=100),
    partial(log, turns=(360,), proved=True, noise=3.0),
    partial(log, wild=0.03, missing=0.03),
    partial(log, there_and_back=True),
)
CLEAN: tuple[Callable[[int], Made], ...] = tuple(
    lambda seed, kind=kind: made(kind(seed))  # type: ignore[misc]
    for kind in KINDS
)
USUAL_FLAGS = frozenset({"outliers-rejected", "gap"})
"""Of logs with wild and missing turns."""


def copied(names: str) -> Change:
    """Return the change that copies columns of a fifth of the log over another one."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        inside = np.flatnonzero((part_of(log) >= 0.5) & (part_of(log) < 0.7))
        start = np.flatnonzero(part_of(log) >= 0.2)[0]
        new = {}
        for key, value in vars(log.table).items():
            if key.startswith(tuple(names.split())):
                new[key] = value.copy()
                new[key][inside] = value[start : start + len(inside)]
        return replace(log, table=replace(log.table, **new))

    return changed


def unmoved(first: float) -> Change:
    """Return the change after which, from a part of the log on, headings do not follow turns."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        table = log.table
        inside = (part_of(log) >= first)[:, None]
        after = np.where(inside, table.attitude_before_deg, table.attitude_after_deg)
        return replace(log, table=replace(table, attitude_after_deg=after))

    return changed


def from_one_place(log: Log, generator: np.random.Generator) -> Log:
    """Return a log whose turns begin at 0 deg, read to 0.1 deg."""
    change = log.table.attitude_after_deg - log.table.attitude_before_deg
    table = replace(log.table, attitude_before_deg=0.0 * change, attitude_after_deg=change)
    return columns("attitude", lambda a: np.round(a, 1))(replace(log, table=table), generator)


def by_chamber(log: Log, _: np.random.Generator) -> Log:
    """Return a log whose gyro temperatures are the chamber's, which leads them by 3 degC."""
    table = log.table
    sides = (table.temperature_before_degC, table.temperature_after_degC)
    before, after = (np.round(side + 3.0, 3) for side in sides)
    new = replace(table, temperature_before_degC=before, temperature_after_degC=after)
    return replace(log, table=replace(new, chamber_degC=before))


def late(names: str, rows: int) -> Change:
    """Return the change that puts columns some rows too late; the first rows stay."""
    return columns(names, lambda v: np.concatenate((v[:rows], v[:-rows])))


def some_back(log: Log, generator: np.random.Generator) -> Log:
    """Return a log in which one command of five has the wrong sign."""
    sign = np.where(generator.random(len(log.table)) < 0.2, -1.0, 1.0)
    table = replace(log.table, commanded_deg=log.table.commanded_deg * sign)
    return replace(log, table=table)


def kept(inside: Shape) -> Change:
    """Return the change that loses the turns outside some temperatures."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        return replace(log, table=rows_of(log.table, inside(log.table.temperature_degC)))

    return changed


def stated(**conditions: str) -> Change:
    """Return the change of conditions."""
    return lambda log, _: replace(log, conditions={**log.conditions, **conditions})


def drive_rates(change: Shape) -> Change:
    """Return the change of a drive's rates."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        drive: Any = log.drive
        return replace(log, drive=replace(drive, rate_deg_per_s=change(drive.rate_deg_per_s)))

    return changed


def off_proof(shape: Shape) -> Change:
    """Return the change of the verification ramp by an error of the scale factor."""

    def changed(log: Log, generator: np.random.Generator) -> Log:
        proof: Any = log.verification
        error = shape(proof.temperature_degC) * proof.commanded_deg / 360.0
        return replace(log, verification=turned(replace(log, table=proof), error).table)

    return changed


# fmt: off
FAULTS: tuple[Fault, ...] = (
    *faults(STATEMENT, ("headings in radians", columns("attitude", np.radians)),
        ("headings in gon", columns("attitude", lambda a: a / 0.9)),
        ("headings as DD.MMSS", columns("attitude", minutes)),
        ("headings in turns", columns("attitude", lambda a: a / 360.0)),
        ("headings after in radians", columns("attitude_after", np.radians)),
        ("headings to 0.1 deg", columns("attitude", lambda a: np.round(a, 1))),
        ("headings to 0.1 deg from one place", from_one_place),
        ("temperatures in kelvin", columns("temperature", lambda t: t + 273.15)),
        ("temperatures in degF", columns("temperature", lambda t: 1.8 * t + 32)),
        ("temperatures in tenths of a degC", columns("temperature", lambda t: 10 * t)),
        ("temperatures with the wrong sign", columns("temperature", np.negative)),
        ("temperature after in kelvin", columns("temperature_after", lambda t: t + 273.15)),
        ("x in degF", columns("temperature", lambda t: 1.8 * t + 32, axes="x")),
        ("x drifts by 8 degC",
        columns("temperature", lambda t: t + np.linspace(0, 8, len(t)), axes="x")),
        ("the table's range is another plan's", stated(temperature_range="[-10 degC, 30 degC]")),
        ("turns 10 deg short", sensed(lambda part: -27778.0)),
        ("turns back called double", columns("commanded", lambda c: np.where(c < 0, 2 * c, c))),
        ("earth's rate not taken off", added(lambda log, _: 350.0)), detectable=True),
    *faults(STATEMENT, ("temperatures one row late", late("temperature", 1)),
        ("temperatures three rows late", late("temperature", 3)),
        ("temperatures after one row late", late("temperature_after", 1)),
        ("headings one row late", late("attitude", 1)),
        ("thermometers step by 2 degC", columns("temperature", lambda t: t + 2.0, 0.4)),
        ("thermometer of x steps by -3 degC",
        columns("temperature", lambda t: t - 3.0, 0.6, axes="x")), detectable=True),
    *faults(STATEMENT, ("times in ms", columns("before_s after_s", lambda t: 1000 * t)),
        ("times in minutes", columns("before_s after_s", lambda t: t / 60)),
        ("headings in radians, single turns", columns("attitude", np.radians)), kind=SINGLE,
        detectable=True),
    *faults(STATEMENT, ("labels exchanged, attitudes known", columns("axis", swapped)),
        ("upside down, attitudes known", columns("attitude", lambda a: a * [1, -1, -1])),
        ("pitch and roll exchanged", columns("attitude", lambda a: a[:, [0, 2, 1]])),
        ("roll with the wrong sign", columns("attitude", lambda a: a * [1, 1, -1])),
        ("pitch and roll in radians",
        columns("attitude", lambda a: np.hstack((a[:, :1], np.radians(a[:, 1:]))))), kind=FULL,
        detectable=True),
    *faults(STATEMENT | NOTHING, ("wrong sense, with a drive", stated(turn_sense="about-up")),
        ("drive in rad/s", drive_rates(np.radians)),
        ("drive with the wrong sign", drive_rates(np.negative)),
        ("drive at the wrong latitude", stated(latitude="-40 deg")), kind=DRIVEN, detectable=True),
    *faults(STATEMENT | LEFT_OUT, ("commands unsigned", columns("commanded", np.abs)),
        ("commands unsigned in the last third", columns("commanded", np.abs, 0.67)),
        ("one command of five with the wrong sign", some_back),
        ("half turns called whole", added(lambda log, _: 5e5)),
        ("headings in radians from the middle", columns("attitude", np.radians, 0.5)),
        ("headings count backwards from the middle",
        columns("attitude", lambda a: 360.0 - a, 0.5)),
        ("labels exchanged from the middle", columns("axis", swapped, 0.5)),
        ("labels exchanged in one set of seven", columns("axis", swapped, 0.4, 0.54)),
        ("temperatures without their sign", columns("temperature", np.abs)), detectable=True),
    *faults(STATEMENT | LEFT_OUT,
        ("waits called turns", columns("commanded", lambda c: 0.0 * c + 360.0)),
        kind=partial(log, turns=(360, 0)), detectable=True),
    *faults(STATEMENT, ("chamber for gyro", by_chamber), kind=partial(log, chamber=True),
        detectable=True),
    *faults(FROZEN,
        ("thermometers stop at the middle", columns("temperature", lambda t: 0 * t + t[0], 0.5)),
        ("thermometers stop for a sixth",
        columns("temperature", lambda t: 0 * t + t[0], 0.5, 0.67)),
        ("thermometer of x dead", columns("temperature", lambda t: 0 * t + 25.0, axes="x")),
        ("headings do not follow from two thirds on", unmoved(0.67)),
        ("headings do not follow", unmoved(0.0)),
        ("headings stop for a sixth", columns("attitude", lambda a: 0 * a + a[0], 0.4, 0.55)),
        ("headings copied from earlier sets", copied("attitude")),
        ("headings and temperatures copied", copied("attitude temperature")), detectable=True),
    *faults(COARSE,
        ("temperatures to 2 degC", columns("temperature", lambda t: np.round(t / 2) * 2)),
        detectable=True),
    *faults(STATEMENT, ("noise 200 times the stated one", noisy(lambda part: 200.0)),
        ("noise 20 times the stated one", noisy(lambda part: 20.0)),
        ("noise 5 times the stated one", noisy(lambda part: 5.0)),
        ("noise 30 times in a third", noisy(lambda part: 30.0 * (part > 0.67))),
        ("noise that grows to 20 times", noisy(lambda part: 20.0 * part**2)), kind=STATED),
    *faults(STATEMENT, ("noise 200 times, single turns", noisy(lambda part: 200.0)),
        kind=partial(log, turns=(360,), stated=True)),
    *faults(LEFT_OUT, ("six sets 60 ppm off", sensed(lambda p: 60.0 * ((p > 0.5) & (p < 0.61)))),
        ("three sets 30 ppm off", sensed(lambda p: 30.0 * ((p > 0.3) & (p < 0.35)))),
        ("warm-up of 40 ppm", sensed(lambda p: 40.0 * np.exp(-p / 0.04))),
        ("last two sets 25 ppm off", sensed(lambda p: 25.0 * (p > 0.97)))),
    *faults(SHAPE, ("step of 20 ppm", sensed(lambda p: 20.0 * (p > 0.55))),
        ("ripple of 10 ppm, 8 sets", sensed(lambda p: 10.0 * np.sin(2 * np.pi * 53 * p / 8))),
        ("feature of 15 ppm and 2 degC", bump(14.0, 1.0, 15.0)),
        ("feature of 25 ppm and 3 degC", bump(31.0, 1.3, 25.0)),
        ("feature of 6 ppm and 4 degC", bump(24.0, 2.0, 6.0)),
        ("kink of 3 ppm/degC", kink(17.0, 3.0)), ("kink of -2 ppm/degC", kink(-5.0, -2.0)),
        ("kink of 1 ppm/degC", kink(17.0, 1.0)), ("kink of 0.5 ppm/degC", kink(10.0, 0.5))),
    *faults(SHAPE, ("step of 60 ppm, single turns", sensed(lambda p: 60.0 * (p > 0.35))),
        ("feature of 15 ppm and 2 degC, single turns", bump(20.5, 1.0, 15.0)),
        ("feature of 40 ppm and 3 degC, single turns", bump(20.5, 1.3, 40.0)),
        ("kink of 1 ppm/degC, single turns", kink(22.0, 1.0)),
        ("kink of 3 ppm/degC, single turns", kink(22.0, 3.0)), kind=SINGLE),
    *faults(STATEMENT, ("verification 20 ppm off", off_proof(lambda t: 20.0)),
        ("verification 20 ppm rms off", off_proof(lambda t: 28.0 * np.sin(t / 15.0))),
        ("verification off at one end", off_proof(lambda t: 15.0 * (t > 45.0))),
        ("verification of other labels", columns("axis", swapped, table="verification")),
        kind=PROVED, detectable=True),
    *faults(frozenset({"hysteresis"}),
        ("hysteresis of 10 ppm", sensed(lambda p: 5.0 * np.sin(2 * np.pi * p))),
        ("thermometers that lag by 1 degC",
        columns("temperature", lambda t: t - np.sign(np.gradient(t)))),
        kind=partial(log, there_and_back=True)),
    *faults(frozenset({"gap"}), ("gap of 80 degC", kept(lambda t: (t < -30) | (t > 50))),
        ("gap of 30 degC", kept(lambda t: (t < 5) | (t > 35))), detectable=True),
    *faults(NOTHING, ("one set number for all", columns("set", np.zeros_like)),
        ("a set number for every row", columns("set", lambda n: np.arange(len(n)))),
        ("set numbers start again", columns("set", lambda n: n % 27)), detectable=True),
    *LABORATORY,
)
# fmt: on


def held(dataset: FogDataset) -> Held:
    """Return a log in memory."""
    return Held(dataset, found_in, lambda _: 0.0)


def found_in(dataset: FogDataset) -> Findings:
    """Return what is found in a log of the shipped specification."""
    return to_findings(analyse(dataset), dataset, [], "specification")


def of(turns: Sequence[int] = (360, -360), **more: Any) -> Callable[[int], Held]:
    """Return the maker of logs of one axis."""
    return lambda seed: held(record(seed, turns, **more))


def with_on_it(shape: Shape, turns: Sequence[int] = (360, -360)) -> Callable[[int], Held]:
    """Return the maker of logs of a gyro with something on its curve."""
    return of(turns, curves={"x": lambda heat: quartic(heat) + shape(heat)})


def feature(at: float, width: float, heat: Values) -> Values:
    """Return a feature of 15 ppm."""
    return np.asarray(15.0 * np.exp(-0.5 * ((heat - at) / width) ** 2))


def heap(width_degC: float) -> Callable[[int], Held]:
    """Return the maker of logs of a curve with a large bump."""
    return with_on_it(lambda heat: 300.0 * np.exp(-0.5 * ((heat - 5.0) / width_degC) ** 2))


def knocked_at_random(dataset: FogDataset, seed: int) -> FogDataset:
    """Return a log of which three turns were knocked."""
    after = dataset.turns.attitude_after_deg
    rows = np.random.default_rng(seed).choice(len(after), 3, replace=False)
    after[rows, 0] += np.array([0.02, -0.05, 0.1])
    return dataset


def in_radians(axes: str) -> Callable[[FogDataset, int], FogDataset]:
    """Return the change of headings of some axes to radians."""

    def change(dataset: FogDataset, _: int) -> FogDataset:
        own = np.isin(dataset.turns.axis, list(axes))[:, None]
        sides = (dataset.turns.attitude_before_deg, dataset.turns.attitude_after_deg)
        before, after = (np.where(own, np.radians(side), side) for side in sides)
        turns = replace(dataset.turns, attitude_before_deg=before, attitude_after_deg=after)
        return replace(dataset, turns=turns)

    return change


def where_heat(inside: Shape) -> Callable[[FogDataset, int], FogDataset]:
    """Return the change that loses the turns outside some temperatures."""
    return lambda one, _: only(one, inside(one.turns.temperature_degC))


def waits(step_degC: float) -> Callable[[FogDataset, int], FogDataset]:
    """Return the change of a ramp to one that waits at 0 degC, read in steps."""

    def change(dataset: FogDataset, _: int) -> FogDataset:
        for side in ("before", "after"):
            heat = getattr(dataset.turns, f"temperature_{side}_degC")
            # The chamber waits at 0 degC and the gyro comes to rest and away slowly.
            heat[:] = np.hypot(heat, 4.0) * np.sign(heat) - 4.0 * np.sign(heat)
            heat[:] = np.round(heat / step_degC) * step_degC if step_degC else heat
        return dataset

    return change


def wild_turns(seed: int) -> Made:
    """Return a log of which some turns are wild."""
    knocks = added(
        lambda one, g: (g.random(len(one.table)) < 0.05) * g.standard_t(3, len(one.table)) * 300.0
    )
    one = log(seed, (360,), stated=True, sets=24)
    return made(knocks(one, np.random.default_rng(seed)))


def proved_beyond(seed: int) -> Held:
    """Return a log whose verification goes beyond the calibrated range."""
    down = record(9, first_degC=40.0, last_degC=-37.0).turns
    return held(replace(record(seed, last_degC=20.0), verification=down))


def with_an_open_drive(seed: int) -> Held:
    """Return a log with a drive that does not come back to its first heading."""
    drive = simulated_drive(dict.fromkeys(CURVES, np.zeros_like), laps=2)
    part = len(drive.time_s) // 5
    cut = replace(
        drive,
        time_s=drive.time_s[:part],
        rate_deg_per_s=drive.rate_deg_per_s[:part],
        temperature_degC=drive.temperature_degC[:part],
        heading_deg=None,
    )
    return held(replace(record(seed, axes=("z",)), drive=cut))


def spoilt(text: str) -> str:
    """Return a table of turns with a wild heading and twelve rows lost."""
    head, *body = text.splitlines()
    cells = body[100].split(",")
    cells[6] = f"{(float(cells[6]) + 0.08) % 360.0:.4f}"
    body[100] = ",".join(cells)
    del body[210:222]
    return "\n".join([head, *body, ""])


def imported(dataset: FogDataset, conditions: str, drive: bool = False) -> Written:
    """Return a log as files, with conditions beside the usual ones."""
    names = {"turns.csv": csv(dataset.turns, full=False)}
    if drive:
        names["drive.csv"] = drive_csv(simulated_drive(dict(CURVES), laps=1))
    stated = "\n".join(f"  {name.removesuffix('.csv')}: {name}" for name in names)
    text = (
        f"dataset: 1\nprocedure: fog-scale-factor-temperature\nfiles:\n{stated}\n"
        f"conditions:\n  attitude_output: heading\n  turn_sense: heading\n{conditions}"
    )
    return Written({**names, "dataset.yaml": text})


SENSES = (("pairs", (360, -360)), ("single turns", (360,)))
SAID = {"angle_random_walk_deg_per_sqrt_h": 0.002, "turntable_accuracy_arcsec": 1.0}
EXAMPLE = example("fog-pairs")
SPOILT = EXAMPLE.but("turns.csv", spoilt)
NO_CURVE = "scale_factor_error"


def said_quiet(turns: Sequence[int], noise: float = 1.0, walk: float = 0.0) -> Callable[..., Held]:
    """Return the maker of logs with their noise stated, really so many times as large."""

    def make(seed: int) -> Held:
        one = record(seed, turns, noise_deg=noise * NOISE_DEG, walk=walk)
        return held(replace(one, **SAID))  # type: ignore[arg-type]

    return make


NAMED: Sequence[tuple[str, int, str]] = (
    ("headings in gon", 1, "contradicts-statement"),
    ("headings as DD.MMSS", 1, "contradicts-statement"),
    ("headings to 0.1 deg", 1, "contradicts-statement"),
    ("temperatures in degF", 1, "contradicts-statement"),
    ("x drifts by 8 degC", 1, "contradicts-statement"),
    ("turns back called double", 1, "contradicts-statement"),
    ("earth's rate not taken off", 1, "contradicts-statement"),
    ("times in ms", 1, "contradicts-statement"),
    ("labels exchanged, attitudes known", 1, "contradicts-statement"),
    ("upside down, attitudes known", 1, "contradicts-statement"),
    ("wrong sense, with a drive", 1, "contradicts-statement"),
    ("commands unsigned", 1, "contradicts-statement outliers-rejected"),
    ("waits called turns", 1, "contradicts-statement outliers-rejected"),
    ("chamber for gyro", 1, "contradicts-statement"),
    ("thermometers stop for a sixth", 1, "frozen"),
    ("headings do not follow from two thirds on", 1, "frozen"),
    ("headings copied from earlier sets", 1, "frozen"),
    ("temperatures to 2 degC", 1, "coarse-output"),
    ("hysteresis of 10 ppm", 1, "hysteresis"),
    ("temperatures one row late", 1, "contradicts-statement"),
    ("temperatures after one row late", 1, "contradicts-statement"),
    ("headings one row late", 1, "contradicts-statement"),
    ("thermometers step by 2 degC", 1, "contradicts-statement"),
    ("thermometer of x steps by -3 degC", 1, "contradicts-statement"),
    ("noise 5 times the stated one", 1, "contradicts-statement"),
    ("headings of x in radians", 0, "contradicts-statement"),
    ("thermometers that lag by 0.5 degC while warming", 0, "hysteresis"),
    ("a third of the rows twice, as new sets", 0, "refused"),
    ("clock begins again in the middle", 0, "refused"),
    ("another gyro for the last sixth", 0, "misfit model-too-stiff outliers-rejected"),
)

# fmt: off
ROWS: Sequence[Row] = (
    *(of_fault(FAULTS, *one) for one in NAMED),
    of_fault(FAULTS, "proof is the calibrating ramp", 0, "contradicts-statement",
        details={"statement": "verification"}, null="residual_scale_factor_error"),
    *(row(f"knocked turns, {turns}", but(of(turns), knocked_at_random), "outliers-rejected",
        seeds=range(8), without="misfit") for turns in ((360, -360), (360,), (360, 0))),
    row("nine sets", of(sets=9), "gap", seeds=(1,), says="far apart"),
    row("six sets",
        lambda seed: held(replace(record(seed, sets=6), angle_random_walk_deg_per_sqrt_h=0.002)),
        "contradicts-statement", seeds=(1,), says="measure more sets (6 "),
    row("wild turns of stated noise", wild_turns, seeds=(1, 6), without="contradicts-statement"),
    *(row(f"a wait at 0 degC, steps of {step:g} degC", but(of(), waits(step)), seeds=(2,),
        without="contradicts-statement") for step in (0.0, 0.5, 1.0)),
    *(row(f"noise 200 times the stated one, {name}", said_quiet(turns, 200.0),
        "contradicts-statement", seeds=(1,),
        details={"statement": "angle_random_walk", "noise_ppm": (200.0, 60.0)},
        clean=said_quiet(turns)) for name, turns in SENSES),
    *(row(f"noise as stated, {name}, walk {walk:g}", said_quiet(turns, walk=walk), seeds=range(15),
        without="misfit contradicts-statement gap") for name, turns in SENSES
        for walk in (0.0, 0.05) if walk == 0.0 or len(turns) > 1),
    *(row(f"headings of x in radians, {name}", but(of(turns), in_radians("x")),
        "contradicts-statement", seeds=(2,), details={"statement": "heading_deg"}, null=NO_CURVE)
        for name, turns in SENSES),
    row("headings of one axis in radians", but(of(axes=("x", "y", "z")), in_radians("x")),
        "contradicts-statement", seeds=(4,), details={"statement": "heading_deg", "axes": ["x"]}),
    *(row(f"feature of 15 ppm and {width:g} degC at {at:.2f} degC",
        with_on_it(partial(feature, at, width)), "misfit", seeds=(seed,),
        details={"at_degC": (at, 4.0)})
        for width in (1.0, 2.0) for seed, at in enumerate(12.3 + 0.37 * np.arange(8))),
    row("a gap of 80 degC", but(of(), where_heat(lambda heat: (heat < -30.0) | (heat > 50.0))),
        "not-identifiable gap", seeds=(3,), says="no value is given",
        details={"coefficients": [NO_CURVE]}, null="*"),
    row("eight sets missing", but(of(),
        lambda one, _: only(one, (one.turns.set_number < 20) | (one.turns.set_number > 27))),
        "gap", details={"missing_sets": 8, "widest_degC": (97.0 / 54 * 9, 0.8)}),
    row("a bump that no order follows", heap(5.0), "model-too-stiff misfit", others="",
        without="outliers-rejected"),
    row("two sets", of(sets=2), "not-identifiable", others=""),
    row("verification beyond the calibrated range", proved_beyond, "extrapolation"),
    row("a drive that does not close", with_an_open_drive, "not-identifiable",
        null="heading_error_compensated"),
    row("the example with wild and lost turns", lambda _: SPOILT, "gap outliers-rejected",
        others=""),
    row("two sets, imported", lambda _: imported(record(0, sets=2), "  soak: 2 h\n"),
        "not-identifiable outside-published-range", others="", null="*"),
    row("reference at 75 degC, imported",
        lambda _: imported(record(0), "  reference_temperature: 75 degC\n"), "extrapolation",
        others="", null=NO_CURVE),
    row("refused: single turns without a bias",
        lambda _: imported(record(0, (360,)), "  soak: 5 h\n"), REFUSED,
        says="conditions.gyro_bias: is missing"),
    row("refused: a drive without a latitude",
        lambda _: imported(record(0), "  soak: 5 h\n", drive=True), REFUSED,
        says="conditions.latitude: is missing"),
    *refusals(
        EXAMPLE,
        ("dataset.yaml", "turn_sense: heading", "turn_sens: heading", "did you mean"),
        ("dataset.yaml", "turn_sense: heading", "turn_sense: up", "turn_sense"),
        ("dataset.yaml", "  turn_sense: heading\n", "", "turn_sense"),
        ("dataset.yaml", "attitude_output: heading", "attitude_output: heading-pitch-roll", "roll"),
        ("dataset.yaml", "gyro_bias: 0.3 deg/h", "gyro_bias: 0.3", "gyro_bias"),
        ("dataset.yaml", "turns: turns.csv", "turn: turns.csv", "turns"),
        ("turns.csv", "commanded_deg", "commanded", "commanded_deg"),
        ("turns.csv", "18122.0,x,360", "18122.0,u,360", "there is no axis 'u'"),
        ("turns.csv", "18075.0,18122.0", "18075.0,18022.0", "is not after t_before_s"),
        ("turns.csv", "\n0,18124.0,", "\n0,18024.0,", "times must rise"),
        ("turns.csv", "318.7529", "north", "heading_before_deg"),
        ("turns.csv", "\n0,18075.0", "\n0.5,18075.0", "not a whole number"),
    ),
)
# fmt: on
