"""Faults of logs of turns over temperature; see `sabotage.py` and `fog_logs.py`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from fog_logs import (
    Change,
    Log,
    Shape,
    added,
    bump,
    columns,
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
from fog_planting import (
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
    Maker,
    faults,
)
from sabotage import Fault, Made
from sabotage_fog_laboratory import LABORATORY

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


FAULTS: tuple[Fault, ...] = (
    *faults(
        STATEMENT,
        ("headings in radians", columns("attitude", np.radians)),
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
        (
            "x drifts by 8 degC",
            columns("temperature", lambda t: t + np.linspace(0, 8, len(t)), axes="x"),
        ),
        ("the table's range is another plan's", stated(temperature_range="[-10 degC, 30 degC]")),
        ("turns 10 deg short", sensed(lambda part: -27778.0)),
        ("turns back called double", columns("commanded", lambda c: np.where(c < 0, 2 * c, c))),
        ("earth's rate not taken off", added(lambda log, _: 350.0)),
        detectable=True,
    ),
    *faults(
        STATEMENT,
        ("temperatures one row late", late("temperature", 1)),
        ("temperatures three rows late", late("temperature", 3)),
        ("temperatures after one row late", late("temperature_after", 1)),
        ("headings one row late", late("attitude", 1)),
        ("thermometers step by 2 degC", columns("temperature", lambda t: t + 2.0, 0.4)),
        (
            "thermometer of x steps by -3 degC",
            columns("temperature", lambda t: t - 3.0, 0.6, axes="x"),
        ),
        detectable=True,
    ),
    *faults(
        STATEMENT,
        ("times in ms", columns("before_s after_s", lambda t: 1000 * t)),
        ("times in minutes", columns("before_s after_s", lambda t: t / 60)),
        ("headings in radians, single turns", columns("attitude", np.radians)),
        kind=SINGLE,
        detectable=True,
    ),
    *faults(
        STATEMENT,
        ("labels exchanged, attitudes known", columns("axis", swapped)),
        ("upside down, attitudes known", columns("attitude", lambda a: a * [1, -1, -1])),
        ("pitch and roll exchanged", columns("attitude", lambda a: a[:, [0, 2, 1]])),
        ("roll with the wrong sign", columns("attitude", lambda a: a * [1, 1, -1])),
        (
            "pitch and roll in radians",
            columns("attitude", lambda a: np.hstack((a[:, :1], np.radians(a[:, 1:])))),
        ),
        kind=FULL,
        detectable=True,
    ),
    *faults(
        STATEMENT | NOTHING,
        ("wrong sense, with a drive", stated(turn_sense="about-up")),
        ("drive in rad/s", drive_rates(np.radians)),
        ("drive with the wrong sign", drive_rates(np.negative)),
        ("drive at the wrong latitude", stated(latitude="-40 deg")),
        kind=DRIVEN,
        detectable=True,
    ),
    *faults(
        STATEMENT | LEFT_OUT,
        ("commands unsigned", columns("commanded", np.abs)),
        ("commands unsigned in the last third", columns("commanded", np.abs, 0.67)),
        ("one command of five with the wrong sign", some_back),
        ("half turns called whole", added(lambda log, _: 5e5)),
        ("headings in radians from the middle", columns("attitude", np.radians, 0.5)),
        ("headings count backwards from the middle", columns("attitude", lambda a: 360.0 - a, 0.5)),
        ("labels exchanged from the middle", columns("axis", swapped, 0.5)),
        ("labels exchanged in one set of seven", columns("axis", swapped, 0.4, 0.54)),
        ("temperatures without their sign", columns("temperature", np.abs)),
        detectable=True,
    ),
    *faults(
        STATEMENT | LEFT_OUT,
        ("waits called turns", columns("commanded", lambda c: 0.0 * c + 360.0)),
        kind=partial(log, turns=(360, 0)),
        detectable=True,
    ),
    *faults(
        STATEMENT,
        ("chamber for gyro", by_chamber),
        kind=partial(log, chamber=True),
        detectable=True,
    ),
    *faults(
        FROZEN,
        ("thermometers stop at the middle", columns("temperature", lambda t: 0 * t + t[0], 0.5)),
        (
            "thermometers stop for a sixth",
            columns("temperature", lambda t: 0 * t + t[0], 0.5, 0.67),
        ),
        ("thermometer of x dead", columns("temperature", lambda t: 0 * t + 25.0, axes="x")),
        ("headings do not follow from two thirds on", unmoved(0.67)),
        ("headings do not follow", unmoved(0.0)),
        ("headings stop for a sixth", columns("attitude", lambda a: 0 * a + a[0], 0.4, 0.55)),
        ("headings copied from earlier sets", copied("attitude")),
        ("headings and temperatures copied", copied("attitude temperature")),
        detectable=True,
    ),
    *faults(
        COARSE,
        ("temperatures to 2 degC", columns("temperature", lambda t: np.round(t / 2) * 2)),
        detectable=True,
    ),
    *faults(
        STATEMENT,
        ("noise 200 times the stated one", noisy(lambda part: 200.0)),
        ("noise 20 times the stated one", noisy(lambda part: 20.0)),
        ("noise 5 times the stated one", noisy(lambda part: 5.0)),
        ("noise 30 times in a third", noisy(lambda part: 30.0 * (part > 0.67))),
        ("noise that grows to 20 times", noisy(lambda part: 20.0 * part**2)),
        kind=STATED,
    ),
    *faults(
        STATEMENT,
        ("noise 200 times, single turns", noisy(lambda part: 200.0)),
        kind=partial(log, turns=(360,), stated=True),
    ),
    *faults(
        LEFT_OUT,
        ("six sets 60 ppm off", sensed(lambda p: 60.0 * ((p > 0.5) & (p < 0.61)))),
        ("three sets 30 ppm off", sensed(lambda p: 30.0 * ((p > 0.3) & (p < 0.35)))),
        ("warm-up of 40 ppm", sensed(lambda p: 40.0 * np.exp(-p / 0.04))),
        ("last two sets 25 ppm off", sensed(lambda p: 25.0 * (p > 0.97))),
    ),
    *faults(
        SHAPE,
        ("step of 20 ppm", sensed(lambda p: 20.0 * (p > 0.55))),
        ("ripple of 10 ppm, 8 sets", sensed(lambda p: 10.0 * np.sin(2 * np.pi * 53 * p / 8))),
        ("feature of 15 ppm and 2 degC", bump(14.0, 1.0, 15.0)),
        ("feature of 25 ppm and 3 degC", bump(31.0, 1.3, 25.0)),
        ("feature of 6 ppm and 4 degC", bump(24.0, 2.0, 6.0)),
        ("kink of 3 ppm/degC", kink(17.0, 3.0)),
        ("kink of -2 ppm/degC", kink(-5.0, -2.0)),
        ("kink of 1 ppm/degC", kink(17.0, 1.0)),
        ("kink of 0.5 ppm/degC", kink(10.0, 0.5)),
    ),
    *faults(
        SHAPE,
        ("step of 60 ppm, single turns", sensed(lambda p: 60.0 * (p > 0.35))),
        ("feature of 15 ppm and 2 degC, single turns", bump(20.5, 1.0, 15.0)),
        ("feature of 40 ppm and 3 degC, single turns", bump(20.5, 1.3, 40.0)),
        ("kink of 1 ppm/degC, single turns", kink(22.0, 1.0)),
        ("kink of 3 ppm/degC, single turns", kink(22.0, 3.0)),
        kind=SINGLE,
    ),
    *faults(
        STATEMENT,
        ("verification 20 ppm off", off_proof(lambda t: 20.0)),
        ("verification 20 ppm rms off", off_proof(lambda t: 28.0 * np.sin(t / 15.0))),
        ("verification off at one end", off_proof(lambda t: 15.0 * (t > 45.0))),
        ("verification of other labels", columns("axis", swapped, table="verification")),
        kind=PROVED,
        detectable=True,
    ),
    *faults(
        frozenset({"hysteresis"}),
        ("hysteresis of 10 ppm", sensed(lambda p: 5.0 * np.sin(2 * np.pi * p))),
        (
            "thermometers that lag by 1 degC",
            columns("temperature", lambda t: t - np.sign(np.gradient(t))),
        ),
        kind=partial(log, there_and_back=True),
    ),
    *faults(
        frozenset({"gap"}),
        ("gap of 80 degC", kept(lambda t: (t < -30) | (t > 50))),
        ("gap of 30 degC", kept(lambda t: (t < 5) | (t > 35))),
        detectable=True,
    ),
    *faults(
        NOTHING,
        ("one set number for all", columns("set", np.zeros_like)),
        ("a set number for every row", columns("set", lambda n: np.arange(len(n)))),
        ("set numbers start again", columns("set", lambda n: n % 27)),
        detectable=True,
    ),
    *LABORATORY,
)
