"""Faults of logs of turns over temperature; see `sabotage.py` and `fog_logs.py`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from fog_logs import AXES, PPM_DEG, Curve, Log, log, made
from numpy.typing import NDArray
from sabotage import Array, Fault, Made

from procedures.fog_scale_factor_temperature.dataset import TurnTable

Mask = NDArray[np.bool_]
Change = Callable[[Log, np.random.Generator], Log]
Maker = Callable[[int], Log]

STATEMENT = frozenset({"contradicts-statement"})
SHAPE = frozenset({"misfit", "model-too-stiff", "output-step"})
LEFT_OUT = frozenset({"outliers-rejected", "model-too-stiff", "misfit"})
NOTHING_SAID = frozenset({"not-identifiable"})

PAIRS: Maker = log
SINGLE: Maker = partial(log, turns=(360,))
WAITS: Maker = partial(log, turns=(360, 0))
FULL: Maker = partial(log, full=True)
PROVED: Maker = partial(log, proved=True)
DRIVEN: Maker = partial(log, driven=True)
CHAMBER: Maker = partial(log, chamber=True)
STATED: Maker = partial(log, stated=True)
KINDS: tuple[Maker, ...] = (
    PAIRS,
    SINGLE,
    PROVED,
    FULL,
    WAITS,
    partial(log, turns=(360, -360, -360, 360)),
    partial(log, resolution_deg=0.01),
    partial(log, driven=True, proved=True),
    partial(log, noise=10.0, bias=0.5, walk=0.1),
    partial(log, sets=24),
    partial(log, turns=(360,), sets=100),
    partial(log, turns=(360,), proved=True, noise=3.0),
)
CLEAN: tuple[Callable[[int], Made], ...] = tuple(
    lambda seed, kind=kind: made(kind(seed))
    for kind in KINDS  # type: ignore[misc]
)
USUAL_FLAGS: frozenset[str] = frozenset()


def turned(log: Log, error_ppm: Array | float) -> Log:
    """Return a log with something added to the errors of its turns, (rows,); headings alone."""
    after = log.table.attitude_after_deg.copy()
    after[:, 0] = np.mod(after[:, 0] + error_ppm * PPM_DEG, 360.0)
    return replace(log, table=replace(log.table, attitude_after_deg=after))


def told(log: Log, **conditions: str) -> Log:
    """Return a log with other conditions."""
    return replace(log, conditions={**log.conditions, **conditions})


def columns(
    name: str | tuple[str, ...], change: Callable[[Array], Array], table: str = "table"
) -> Change:
    """Return the change of all columns of the table whose name begins so."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        old: TurnTable = getattr(log, table)
        new = {key: change(value) for key, value in vars(old).items() if key.startswith(name)}
        return replace(log, **{table: replace(old, **new)})  # type: ignore[arg-type]

    return changed


def rows(
    name: str,
    change: Callable[[Array], Array],
    first: float = 0.0,
    last: float = 1.0,
    axes: str = "xyz",
) -> Change:
    """Return the change of columns between two parts of the log, at some axes."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        table = log.table
        inside = between(log, first, last) & np.isin(table.axis, list(axes))
        new = {}
        for key, value in vars(table).items():
            if key.startswith(name):
                new[key] = value.copy()
                new[key][inside] = change(value[inside])
        return replace(log, table=replace(table, **new))

    return changed


def between(log: Log, first: float, last: float) -> Mask:
    """Return the rows between two parts of the log's sets."""
    part = log.table.set_number / (log.table.set_number.max() + 1)
    return np.asarray((part >= first) & (part < last))


def added(error: Callable[[Log, np.random.Generator], Array]) -> Change:
    """Return the change that adds an error in ppm to each turn, whatever its sense."""
    return lambda log, generator: turned(log, error(log, generator))


def curved(shape: Callable[[Array], Array]) -> Change:
    """Return the change to a gyro whose curve has something on it."""

    def with_it(curve: Curve) -> Curve:
        return lambda heat: curve(heat) + shape(np.asarray(heat))

    def changed(log: Log, _: np.random.Generator) -> Log:
        error = shape(log.table.temperature_degC) * log.table.commanded_deg / 360.0
        curves = {axis: with_it(log.curves[axis]) for axis in AXES}
        return replace(turned(log, error), curves=curves)

    return changed


def sensed(shape: Callable[[Log, Array], Array]) -> Change:
    """Return the change that adds an error of the scale factor, over the part of the log 0 to 1."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        part = log.table.set_number / log.table.set_number.max()
        return turned(log, shape(log, part) * log.table.commanded_deg / 360.0)

    return changed


def noisy(ppm: Callable[[Array], Array]) -> Change:
    """Return the change that adds noise, of a size over the part of the log 0 to 1."""

    def changed(log: Log, generator: np.random.Generator) -> Log:
        part = log.table.set_number / log.table.set_number.max()
        return turned(log, ppm(part) * generator.standard_normal(len(part)))

    return changed


def exchanged(first: float, last: float) -> Change:
    """Return the change of the labels x and y between two parts of the log."""
    return rows(
        "axis",
        lambda axis: np.where(axis == "x", "y", np.where(axis == "y", "x", axis)),
        first,
        last,
    )


def copied(first: float, last: float, source: float, names: str) -> Change:
    """Return the change that copies columns of a block of sets over another one."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        inside = np.flatnonzero(between(log, first, last))
        start = np.flatnonzero(between(log, source, 2.0))[0]
        new = {}
        for key, value in vars(log.table).items():
            if key.startswith(tuple(names.split())):
                new[key] = value.copy()
                new[key][inside] = value[start : start + len(inside)]
        return replace(log, table=replace(log.table, **new))

    return changed


def stopped(
    first: float, last: float, axes: str = "xyz", *, name: str, share: float = 0.0
) -> Change:
    """Return the change that holds a column's reading from one part of the log to another."""
    return rows(
        name, lambda value: np.zeros_like(value) + value[int(share * len(value))], first, last, axes
    )


def unmoved(first: float, last: float) -> Change:
    """Return the change after which headings did not follow the turns."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        inside = between(log, first, last)[:, None]
        table = log.table
        after = np.where(inside, table.attitude_before_deg, table.attitude_after_deg)
        return replace(log, table=replace(table, attitude_after_deg=after))

    return changed


def by_chamber(log: Log) -> Log:
    """Return a log whose gyro temperatures are the chamber's, which leads them by 3 degC."""
    table = log.table
    sides = (table.temperature_before_degC, table.temperature_after_degC)
    before, after = (np.round(side + 3.0, 3) for side in sides)
    chamber = np.where(np.isfinite(table.chamber_degC), before, np.nan)
    new = replace(table, temperature_before_degC=before, temperature_after_degC=after)
    return replace(log, table=replace(new, chamber_degC=chamber))


def minutes(angle: Array) -> Array:
    """Return degrees as degrees, minutes and seconds, DD.MMSS."""
    seconds = np.round(angle * 3600.0 * 100.0) / 100.0
    return np.asarray(seconds // 3600 + seconds % 3600 // 60 * 0.01 + seconds % 60 * 1e-4)


def kept(inside: Callable[[Array], Mask]) -> Change:
    """Return the change that loses the turns outside some temperatures."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        row = inside(log.table.temperature_degC)
        return replace(log, table=TurnTable(**{k: v[row] for k, v in vars(log.table).items()}))

    return changed


def stated(**conditions: str) -> Change:
    """Return the change of conditions."""
    return lambda log, _: told(log, **conditions)


def driving(change: Callable[[Any], Any]) -> Change:
    """Return the change of the drive."""
    return lambda log, _: replace(log, drive=change(log.drive))


def full_attitude(order: list[int], sign: list[float]) -> Change:
    """Return the change of the columns heading, pitch and roll."""
    return columns("attitude", lambda angle: angle[:, order] * sign)


def bump(at: float, width: float, ppm: float) -> Change:
    """Return the change to a curve with a narrow feature."""
    return curved(lambda heat: ppm * np.exp(-0.5 * ((heat - at) / width) ** 2))


def kink(at: float, slope: float) -> Change:
    """Return the change to a curve with a kink."""
    return curved(lambda heat: slope * np.maximum(heat - at, 0.0))


def off_proof(shape: Callable[[Array], Array]) -> Change:
    """Return the change of the verification ramp by an error of the scale factor."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        proof: Any = log.verification
        after = proof.attitude_after_deg.copy()
        error = shape(proof.temperature_degC) * proof.commanded_deg / 360.0
        after[:, 0] = np.mod(after[:, 0] + error * PPM_DEG, 360.0)
        return replace(log, verification=replace(proof, attitude_after_deg=after))

    return changed


def fault(
    name: str,
    flags: frozenset[str],
    change: Change,
    kind: Maker = PAIRS,
    detectable: bool | None = None,
) -> Fault:
    """Return a fault; `detectable` where more than the errors of the turns shows it, or less."""

    def planted(seed: int) -> Made:
        return made(change(kind(seed), np.random.default_rng([seed, 23])))

    return Fault(name, flags, lambda seed: made(kind(seed)), planted, detectable)


COMMAND = STATEMENT | LEFT_OUT
FAULTS = (
    fault("headings in radians", STATEMENT, columns("attitude", np.radians), PAIRS, True),
    fault("headings in gon", STATEMENT, columns("attitude", lambda a: a / 0.9), PAIRS, True),
    fault("headings in mils", STATEMENT, columns("attitude", lambda a: a / 0.05625), PAIRS, True),
    fault("headings as DD.MMSS", STATEMENT, columns("attitude", minutes), PAIRS, True),
    fault("headings in turns", STATEMENT, columns("attitude", lambda a: a / 360.0), PAIRS, True),
    fault(
        "headings after in radians", STATEMENT, columns("attitude_after", np.radians), PAIRS, True
    ),
    fault(
        "headings in radians from the middle",
        COMMAND,
        rows("attitude", np.radians, 0.5),
        PAIRS,
        True,
    ),
    fault(
        "temperatures in kelvin",
        STATEMENT,
        columns("temperature", lambda t: t + 273.15),
        PAIRS,
        True,
    ),
    fault(
        "temperatures in degF",
        STATEMENT,
        columns("temperature", lambda t: 1.8 * t + 32),
        PAIRS,
        True,
    ),
    fault(
        "temperatures in tenths", STATEMENT, columns("temperature", lambda t: 10 * t), PAIRS, True
    ),
    fault(
        "temperatures of x in degF",
        STATEMENT,
        rows("temperature", lambda t: 1.8 * t + 32, axes="x"),
        PAIRS,
        True,
    ),
    fault(
        "temperature after in kelvin",
        STATEMENT,
        columns("temperature_after", lambda t: t + 273.15),
        PAIRS,
        True,
    ),
    fault(
        "times in ms", STATEMENT, columns(("before_s", "after_s"), lambda t: 1000 * t), SINGLE, True
    ),
    fault(
        "times in minutes",
        STATEMENT,
        columns(("before_s", "after_s"), lambda t: t / 60),
        SINGLE,
        True,
    ),
    fault(
        "commands in radians",
        STATEMENT | NOTHING_SAID,
        columns("commanded", np.radians),
        PAIRS,
        True,
    ),
    fault("commands unsigned", COMMAND, columns("commanded", np.abs), PAIRS, True),
    fault(
        "commands unsigned in the last third", COMMAND, rows("commanded", np.abs, 0.67), PAIRS, True
    ),
    fault(
        "one command in five with the wrong sign",
        COMMAND,
        lambda log, g: replace(
            log,
            table=replace(
                log.table,
                commanded_deg=log.table.commanded_deg
                * np.where(g.random(len(log.table)) < 0.2, -1, 1),
            ),
        ),
        PAIRS,
        True,
    ),
    fault(
        "waits called turns",
        COMMAND,
        columns("commanded", lambda c: np.full_like(c, 360.0)),
        WAITS,
        True,
    ),
    fault(
        "half turns called whole",
        COMMAND,
        added(lambda log, g: np.full(len(log.table), 5e5)),
        PAIRS,
        True,
    ),
    fault(
        "turns 10 deg short",
        COMMAND,
        added(lambda log, g: -np.sign(log.table.commanded_deg) * 27778.0),
        PAIRS,
        True,
    ),
    fault(
        "turns back called double",
        COMMAND,
        columns("commanded", lambda c: np.where(c < 0, 2 * c, c)),
        PAIRS,
        True,
    ),
    fault("labels of x and y exchanged from the middle", COMMAND, exchanged(0.5, 1.0), PAIRS, True),
    fault(
        "labels of x and y exchanged in one set of seven",
        COMMAND,
        exchanged(0.4, 0.54),
        PAIRS,
        True,
    ),
    fault(
        "labels of x and y exchanged, attitudes known", STATEMENT, exchanged(0.0, 1.0), FULL, True
    ),
    fault(
        "all upside down, attitudes known",
        STATEMENT,
        full_attitude([0, 1, 2], [1, -1, -1]),
        FULL,
        True,
    ),
    fault("pitch and roll exchanged", STATEMENT, full_attitude([0, 2, 1], [1, 1, 1]), FULL, True),
    fault("roll with the wrong sign", STATEMENT, full_attitude([0, 1, 2], [1, 1, -1]), FULL, True),
    fault(
        "pitch and roll in radians",
        STATEMENT,
        full_attitude([0, 1, 2], [1, np.pi / 180, np.pi / 180]),
        FULL,
        True,
    ),
    fault("wrong sense, with a drive", STATEMENT, stated(turn_sense="about-up"), DRIVEN, True),
    fault(
        "headings count backwards from the middle",
        COMMAND,
        rows("attitude", lambda a: 360.0 - a, 0.5),
        PAIRS,
        True,
    ),
    fault(
        "thermometers stop at the middle",
        STATEMENT | {"frozen"} | LEFT_OUT,
        stopped(0.5, 1.0, name="temperature"),
        PAIRS,
        True,
    ),
    fault(
        "thermometers stop for a sixth",
        STATEMENT | {"frozen"} | LEFT_OUT,
        stopped(0.5, 0.67, name="temperature"),
        PAIRS,
        True,
    ),
    fault(
        "thermometer of x dead",
        STATEMENT | {"frozen"} | NOTHING_SAID,
        stopped(0.0, 1.0, "x", name="temperature"),
        PAIRS,
        True,
    ),
    fault("chamber for gyro", STATEMENT, lambda log, g: by_chamber(log), CHAMBER, True),
    fault(
        "temperatures without their sign",
        STATEMENT | LEFT_OUT,
        columns("temperature", np.abs),
        PAIRS,
        True,
    ),
    fault(
        "temperatures with the wrong sign",
        STATEMENT,
        columns("temperature", np.negative),
        PAIRS,
        True,
    ),
    fault(
        "thermometer of x drifts by 8 degC",
        STATEMENT,
        lambda log, g: rows("temperature", lambda t: t + np.linspace(0, 8, len(t)), axes="x")(
            log, g
        ),
        PAIRS,
        True,
    ),
    fault(
        "temperatures to 2 degC",
        STATEMENT | {"coarse-output", "model-too-stiff"},
        columns("temperature", lambda t: np.round(t / 2) * 2),
        PAIRS,
        True,
    ),
    fault(
        "headings do not follow from two thirds on",
        {"frozen"} | COMMAND,
        unmoved(0.67, 1.0),
        PAIRS,
        True,
    ),
    fault("headings do not follow", frozenset({"frozen"}), unmoved(0.0, 1.0), PAIRS, True),
    fault(
        "headings stop for a sixth",
        {"frozen"} | COMMAND,
        stopped(0.4, 0.55, name="attitude"),
        PAIRS,
        True,
    ),
    fault(
        "headings copied from earlier sets",
        {"frozen"} | COMMAND,
        copied(0.5, 0.7, 0.2, "attitude"),
        PAIRS,
        True,
    ),
    fault(
        "headings and temperatures copied",
        {"frozen"} | COMMAND,
        copied(0.5, 0.7, 0.2, "attitude temperature"),
        PAIRS,
        True,
    ),
    fault(
        "noise 200 times the stated one", STATEMENT, noisy(lambda part: 200.0 + 0 * part), STATED
    ),
    fault(
        "noise 20 times, single turns",
        STATEMENT,
        noisy(lambda part: 20.0 + 0 * part),
        partial(log, turns=(360,), stated=True),
    ),
    fault("noise 5 times", STATEMENT, noisy(lambda part: 5.0 + 0 * part), STATED),
    fault(
        "noise 30 times in a third", STATEMENT | LEFT_OUT, noisy(lambda part: 30.0 * (part > 0.67))
    ),
    fault("noise that grows to 20 times", STATEMENT | LEFT_OUT, noisy(lambda part: 20.0 * part**2)),
    fault(
        "headings to 0.1 deg",
        STATEMENT | {"coarse-output"},
        columns("attitude", lambda a: np.round(a, 1)),
        PAIRS,
        True,
    ),
    fault(
        "headings to 0.1 deg from the same place",
        STATEMENT | {"coarse-output"},
        lambda log, g: columns("attitude", lambda a: np.round(a, 1))(
            replace(
                log,
                table=replace(
                    log.table,
                    attitude_before_deg=0 * log.table.attitude_before_deg,
                    attitude_after_deg=log.table.attitude_after_deg - log.table.attitude_before_deg,
                ),
            ),
            g,
        ),
        PAIRS,
        True,
    ),
    fault(
        "six sets 60 ppm off",
        SHAPE | LEFT_OUT,
        sensed(lambda log, p: 60.0 * ((p > 0.5) & (p < 0.61))),
    ),
    fault(
        "three sets 30 ppm off",
        SHAPE | LEFT_OUT,
        sensed(lambda log, p: 30.0 * ((p > 0.3) & (p < 0.35))),
    ),
    fault("step of 20 ppm", SHAPE, sensed(lambda log, p: 20.0 * (p > 0.55))),
    fault("step of 60 ppm, single turns", SHAPE, sensed(lambda log, p: 60.0 * (p > 0.35)), SINGLE),
    fault("warm-up of 40 ppm", SHAPE | LEFT_OUT, sensed(lambda log, p: 40.0 * np.exp(-p / 0.04))),
    fault("warm-up of 10 ppm", SHAPE | LEFT_OUT, sensed(lambda log, p: 10.0 * np.exp(-p / 0.04))),
    fault("last two sets 25 ppm off", SHAPE | LEFT_OUT, sensed(lambda log, p: 25.0 * (p > 0.97))),
    fault(
        "ripple of 10 ppm, 8 sets",
        SHAPE | STATEMENT,
        sensed(lambda log, p: 10.0 * np.sin(2 * np.pi * 53 * p / 8)),
    ),
    fault("feature of 15 ppm and 2 degC", SHAPE, bump(14.0, 1.0, 15.0)),
    fault("feature of 6 ppm and 4 degC", SHAPE, bump(24.0, 2.0, 6.0)),
    fault("feature of 15 ppm and 2 degC, single turns", SHAPE, bump(20.5, 1.0, 15.0), SINGLE),
    fault("kink of 3 ppm/degC", SHAPE, kink(17.0, 3.0)),
    fault("kink of 1 ppm/degC", SHAPE, kink(17.0, 1.0)),
    fault("kink of 0.5 ppm/degC", SHAPE, kink(10.0, 0.5)),
    fault("kink of 1 ppm/degC, single turns", SHAPE, kink(22.0, 1.0), SINGLE),
    fault(
        "saturates at 80 ppm",
        SHAPE,
        lambda log, g: sensed(
            lambda log, p: (
                np.minimum(log.error_ppm(log.table) / (log.table.commanded_deg / 360.0), 80.0)
                - log.error_ppm(log.table) / (log.table.commanded_deg / 360.0)
            )
        )(log, g),
    ),
    fault("verification 20 ppm off", STATEMENT, off_proof(lambda t: 20.0 + 0 * t), PROVED),
    fault("verification 4 ppm off", STATEMENT, off_proof(lambda t: 4.0 + 0 * t), PROVED),
    fault("verification off at one end", STATEMENT, off_proof(lambda t: 15.0 * (t > 45.0)), PROVED),
    fault(
        "verification with labels exchanged",
        STATEMENT,
        columns(
            "axis", lambda a: np.where(a == "x", "y", np.where(a == "y", "x", a)), "verification"
        ),
        PROVED,
        True,
    ),
    fault("gap of 80 degC", frozenset({"gap"}), kept(lambda t: (t < -30) | (t > 50)), PAIRS, True),
    fault("gap of 30 degC", frozenset({"gap"}), kept(lambda t: (t < 5) | (t > 35)), PAIRS, True),
    fault(
        "bias 50 times the stated one",
        STATEMENT,
        added(lambda log, g: np.full(len(log.table), 350.0)),
        PAIRS,
        True,
    ),
    fault("one set number for all", NOTHING_SAID, columns("set", np.zeros_like), PAIRS, True),
    fault(
        "a set number for every row",
        NOTHING_SAID,
        columns("set", lambda n: np.arange(len(n))),
        PAIRS,
        True,
    ),
    fault(
        "set numbers start again",
        NOTHING_SAID | COMMAND,
        columns("set", lambda n: n % 27),
        PAIRS,
        True,
    ),
    fault(
        "temperature range of another plan",
        STATEMENT,
        stated(temperature_range="[-10 degC, 30 degC]"),
        PAIRS,
        True,
    ),
    fault(
        "drive in rad/s",
        STATEMENT | NOTHING_SAID,
        driving(lambda d: replace(d, rate_deg_per_s=np.radians(d.rate_deg_per_s))),
        DRIVEN,
        True,
    ),
    fault(
        "drive at the wrong latitude",
        STATEMENT | NOTHING_SAID,
        stated(latitude="-40 deg"),
        DRIVEN,
        True,
    ),
    fault(
        "drive with the wrong sign",
        STATEMENT | NOTHING_SAID,
        driving(lambda d: replace(d, rate_deg_per_s=-d.rate_deg_per_s)),
        DRIVEN,
        True,
    ),
)
