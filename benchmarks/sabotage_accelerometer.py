"""Faults of the accelerometer's magnetic sensitivity, each a change of a table's columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from accelerometer_records import INTERVAL_S, TRUTH, axes_g
from accelerometer_tables import (
    ASCENDING,
    EFFICIENT,
    KINDS,
    ON_OFF,
    ONE_PLANE,
    PALINDROME,
    THREE_PLANES,
    Kind,
    Plant,
    Table,
    made,
)
from numpy.typing import NDArray
from sabotage import Fault

Array = NDArray[np.float64]
USUAL_FLAGS = frozenset({"not-identifiable", "not-significant", "drift-removed"})
CLEAN = [partial(made, kind) for kind in KINDS]


def output(change: Callable[[Table], NDArray[Any]]) -> Plant:
    """Add something to the output."""

    def plant(one: Table) -> None:
        one.output_V = one.output_V + change(one)

    return plant


def slope(one: Table) -> Array:
    """Return the derivative of the output by the angle, V/rad."""
    turned = axes_g(one.plane, np.radians(one.theta_deg) + 0.5 * np.pi)
    return np.asarray(TRUTH["Ki"] * turned[0])


def turn(change_deg: Callable[[Table], NDArray[Any]]) -> Plant:
    """The table stands elsewhere than the encoder says."""
    return output(lambda one: slope(one) * np.radians(change_deg(one)))


def column(name: str, change: Callable[[Table], NDArray[Any]]) -> Plant:
    """Replace a recorded column."""

    def plant(one: Table) -> None:
        setattr(one, name, change(one))

    return plant


def after(one: Table, low: float = 0.3, high: float = 0.7) -> Array:
    """Return 1 from a row on."""
    return np.asarray(np.arange(len(one)) >= one.row(low, high), dtype=np.float64)


def within(one: Table, part: float) -> Array:
    """Return 1 in a stretch that is this part of the rows."""
    first, rows = np.arange(len(one)), max(int(part * len(one)), 2)
    begin = one.row(0.1, 0.9 - part)
    return np.asarray((first >= begin) & (first < begin + rows), dtype=np.float64)


def went(one: Table) -> Array:
    """Return +1 where the field has come up last, -1 where it has come down."""
    steps = np.sign(np.diff(one.field_commanded_T, prepend=one.field_commanded_T[0] - 1.0))
    for n in range(1, len(steps)):
        steps[n] = steps[n] or steps[n - 1]
    return np.asarray(steps)


def before(values: Array, rows: int = 1) -> Array:
    """Return the values of `rows` rows before."""
    return np.concatenate((values[:1].repeat(rows), values[:-rows]))


def stuck(one: Table, values: Array, part: float) -> Array:
    """Repeat one reading over a stretch."""
    inside = within(one, part) > 0.0
    return np.where(inside, values[np.argmax(inside)], values)


def in_plane(one: Table, plane: str = "ip") -> NDArray[np.bool_]:
    """Return which rows are of a plane; of the first half where there is one plane only."""
    found = one.plane == plane
    return np.asarray(found if found.any() else np.arange(len(one)) < len(one) // 2)


def relabelled(one: Table, old: str, new: str, part: float = 1.0) -> None:
    """Write another plane's name beside the rows of a plane, from a row of it on."""
    rows = np.flatnonzero(one.plane == old)
    one.plane[rows[int((1.0 - part) * len(rows)) :]] = new


def one_angle(one: Table) -> NDArray[np.bool_]:
    """Return the rows at one angle of one plane, where the output moves with the angle."""
    here = np.flatnonzero(np.abs(slope(one)) > 0.6)
    row = int(one.generator.choice(here))
    return np.asarray((one.plane == one.plane[row]) & (one.theta_deg == one.theta_deg[row]))


def copied(one: Table) -> None:
    """The last fifth of the rows holds the outputs of the first fifth, as measured there."""
    count = len(one) // 5
    for name in ("field_T", "temperature_degC", "output_V"):
        values = getattr(one, name).copy()
        values[-count:] = values[:count]
        setattr(one, name, values)


def doubled(one: Table) -> None:
    """Every row of a stretch stands twice, as after a retry."""
    rows = np.arange(len(one))
    twice = np.sort(np.concatenate((rows, rows[within(one, 0.3) > 0.0])))
    one.keep(twice)
    one.t_s = INTERVAL_S * np.arange(len(one), dtype=np.float64)


def lost(one: Table) -> None:
    """A stretch of rows is missing."""
    one.keep(within(one, 0.15) == 0.0)


def filled(one: Table) -> None:
    """Missing outputs were filled in by straight lines."""
    gone = one.generator.random(len(one)) < 0.12
    rows = np.arange(len(one), dtype=np.float64)
    one.output_V[gone] = np.interp(rows[gone], rows[~gone], one.output_V[~gone])


def mixed_up(one: Table) -> None:
    """A tenth of the rows have their outputs in another order."""
    rows = np.flatnonzero(one.generator.random(len(one)) < 0.1)
    one.output_V[rows] = one.output_V[np.roll(rows, 1)]


def sign_lost(names: str) -> Plant:
    """Columns of the field hold its size."""

    def plant(one: Table) -> None:
        for name in names.split():
            setattr(one, name, np.abs(getattr(one, name)))

    return plant


def exchanged(one: Table) -> None:
    """The measured and the commanded field stand in each other's column."""
    one.field_T, one.field_commanded_T = one.field_commanded_T, one.field_T


def spikes(one: Table) -> Array:
    """Return spikes of 0.1 to 10 mV in a twentieth of the rows."""
    size = 10.0 ** one.generator.uniform(-4.0, -2.0, len(one))
    there = one.generator.random(len(one)) < 0.05
    return np.where(there, size * one.generator.choice([-1.0, 1.0], len(one)), 0.0)


def _fault(
    name: str, flags: str, kind: Kind, plant: Plant, detectable: bool | None = None
) -> Fault:
    clean, planted = partial(made, kind), partial(made, kind, plant=plant)
    return Fault(f"{name}; {kind.plan.name}", frozenset(flags.split()), clean, planted, detectable)


STEP, SETTLED, HYSTERESIS = "output-step", "not-settled", "hysteresis"
FIELD = "field-differs-from-commanded"
PLANE, ENCODER, MISFIT = "wrong-position", "encoder-jump misfit", "misfit"
BURST = "outliers-rejected misfit output-step"
UNIT = "contradicts-statement"
SIGN = "contradicts-statement field-differs-from-commanded"


def _field(change: Callable[[Table], NDArray[Any]]) -> Plant:
    return column("field_T", lambda one: one.field_T + change(one))


def _theta(change: Callable[[Table], NDArray[Any]]) -> Plant:
    return column("theta_deg", change)


def _warm(change: Callable[[Table], NDArray[Any]]) -> Plant:
    return column("temperature_degC", change)


def _made_less(limit: float, name: str = "output_V") -> Plant:
    return column(name, lambda one: np.clip(getattr(one, name), -limit, limit))


def _rounded(name: str, step: float) -> Plant:
    return column(name, lambda one: step * np.round(getattr(one, name) / step))


def _other_plane(change: Callable[[Table, NDArray[np.bool_]], NDArray[Any]]) -> Plant:
    return column("output_V", lambda one: change(one, in_plane(one)))


def _quiet(one: Table) -> Array:
    """Return noise that grows to ten times its size."""
    growing = one.kind.noise_V * np.linspace(0.0, 10.0, len(one))
    return np.asarray(growing * one.generator.standard_normal(len(one)))


_S, _E, _P, _A, _O, _F = THREE_PLANES, EFFICIENT, PALINDROME, ASCENDING, ONE_PLANE, ON_OFF
# fmt: off
_PLANTED: Sequence[tuple[str, str, Sequence[Kind], Plant]] = (
    ("output step 100 uV", STEP, (_S, _E, _P, _O), output(lambda t: 100e-6 * after(t))),
    ("output step 30 uV", STEP, (_S, _E, _A), output(lambda t: -30e-6 * after(t))),
    ("gain step 100 ppm", STEP, (_S, _E, _A), output(lambda t: 1e-4 * t.output_V * after(t))),
    ("gain step 0.5 %", STEP + " misfit", (_S, _O), output(lambda t: 5e-3 * t.output_V * after(t))),
    ("burst of 50 uV", BURST, (_S, _E), output(lambda t: 50e-6 * within(t, 0.08))),
    ("spikes", "outliers-rejected", (_S, _O), output(spikes)),
    ("mains, aliased, 40 uV", "periodic misfit", (_S, _A),
     output(lambda t: 40e-6 * np.sin(2.0 * np.pi * 0.2003 * np.arange(len(t))))),
    ("hysteresis of the device, 20 uV", HYSTERESIS, (_P, _E), output(lambda t: 1e-5 * went(t))),
    ("hysteresis of the scale, 40 ppm", HYSTERESIS, (_P, _E),
     output(lambda t: 2e-5 * went(t) * t.axes()[0])),
    ("hysteresis, one way only", "hysteresis misfit", (_A,),
     output(lambda t: 20e-6 * (went(t) - np.mean(went(t))))),
    ("remanence, 3 % of the last field", HYSTERESIS, (_S, _E, _A),
     output(lambda t: 0.03 * TRUTH["Km"] * before(t.field_T))),
    ("voltmeter lags 0.1 %", SETTLED, (_S, _E, _P),
     output(lambda t: 1e-3 * (before(t.output_V) - t.output_V))),
    ("voltmeter lags 3 %", SETTLED, (_S, _E, _O),
     output(lambda t: 0.03 * (before(t.output_V) - t.output_V))),
    ("gaussmeter lags 3 %", SETTLED + " " + FIELD, (_S, _E, _A),
     _field(lambda t: 0.03 * (before(t.field_T) - t.field_T))),
    ("output one row late", SETTLED + " " + UNIT, (_S, _O),
     column("output_V", lambda t: before(t.output_V))),
    ("field one row late", FIELD, (_S, _P), column("field_T", lambda t: before(t.field_T))),
    ("field of the other sign", FIELD, (_S, _O), column("field_T", lambda t: -t.field_T)),
    ("sign of the field lost", SIGN, (_S, _E, _P), sign_lost("field_T field_commanded_T")),
    ("sign of the field lost, measured", FIELD, (_S, _E, _P), sign_lost("field_T")),
    ("sign of the field lost, commanded", FIELD, (_S, _E, _P), sign_lost("field_commanded_T")),
    ("field in mT", FIELD, (_S, _A), column("field_T", lambda t: 1e3 * t.field_T)),
    ("field in G from a row on", FIELD, (_S, _A),
     column("field_T", lambda t: t.field_T * (1.0 + 9999.0 * after(t)))),
    ("gaussmeter gain steps 2 %", FIELD, (_S, _P), _field(lambda t: 0.02 * after(t) * t.field_T)),
    ("gaussmeter gain drifts 0.8 %", FIELD, (_S, _A, _P),
     _field(lambda t: 0.008 * np.linspace(0.0, 1.0, len(t)) * t.field_T)),
    ("gaussmeter zero off 2 mT", FIELD, (_S, _E), _field(lambda t: np.full(len(t), 2e-3))),
    ("gaussmeter zero drifts 1 mT", FIELD, (_S, _P),
     _field(lambda t: 1e-3 * np.linspace(0.0, 1.0, len(t)))),
    ("gaussmeter noise 0.3 mT", FIELD, (_S, _P),
     _field(lambda t: 3e-4 * t.generator.standard_normal(len(t)))),
    ("gaussmeter overranges at 35 mT", FIELD + " saturated", (_S, _A),
     _made_less(0.035, "field_T")),
    ("gaussmeter frozen", "frozen", (_S, _E, _A),
     column("field_T", lambda t: stuck(t, t.field_T, 0.3))),
    ("voltmeter frozen", "frozen", (_S, _E, _O),
     column("output_V", lambda t: stuck(t, t.output_V, 0.2))),
    ("voltmeter frozen for four rows", "frozen outliers-rejected", (_S, _A),
     column("output_V", lambda t: stuck(t, t.output_V, 4.5 / len(t)))),
    ("thermometer frozen", "frozen", (_P, _A), _warm(lambda t: stuck(t, t.temperature_degC, 0.5))),
    ("thermometer measures the room", "drift-removed", (_P,),
     _warm(lambda t: 23.0 + 0.02 * t.generator.standard_normal(len(t)))),
    ("thermometer in another unit", "", (_P,), _warm(lambda t: 1.8 * t.temperature_degC + 32.0)),
    ("thermometer spikes of 3 K", "outliers-rejected", (_P, _S),
     _warm(lambda t: t.temperature_degC + 3.0 * (t.generator.random(len(t)) < 0.04))),
    ("thermometer steps 2 K", "misfit contradicts-statement", (_P, _S),
     _warm(lambda t: t.temperature_degC + 2.0 * after(t))),
    ("thermometer drifts 1 K", "contradicts-statement", (_S,),
     _warm(lambda t: t.temperature_degC + np.linspace(0.0, 1.0, len(t)))),
    ("output clipped at 0.95 V", "saturated", (_S, _E, _O), _made_less(0.95)),
    ("output clipped at 0.45 V", "saturated", (_S, _A), _made_less(0.45)),
    ("output in steps of 1 mV", "coarse-output", (_S, _O, _E), _rounded("output_V", 1e-3)),
    ("encoder in steps of 0.1 deg", ENCODER, (_S, _E),
     turn(lambda t: 0.05 * np.sin(7.0 * np.radians(t.theta_deg)))),
    ("encoder jumps 0.02 deg", ENCODER, (_S, _E), turn(lambda t: 0.02 * after(t))),
    ("encoder twice a turn, 20 arcsec", ENCODER, (_S, _A),
     turn(lambda t: np.sin(np.radians(3.0 * t.theta_deg)) / 180.0)),
    ("encoder counts 0.1 % less", ENCODER, (_S, _E), _theta(lambda t: 0.999 * t.theta_deg)),
    ("encoder slips slowly by 0.1 deg", ENCODER, (_S, _E),
     turn(lambda t: 0.1 * np.linspace(0.0, 1.0, len(t)))),
    ("angle in rad", UNIT, (_S, _O), _theta(lambda t: np.radians(t.theta_deg))),
    ("angle in gon", UNIT, (_S, _O), _theta(lambda t: t.theta_deg / 0.9)),
    ("angle of the other sense in a plane", PLANE, (_S, _E),
     _theta(lambda t: np.where(in_plane(t), -t.theta_deg, t.theta_deg))),
    ("angle 90 deg off", PLANE + " contradicts-statement", (_S, _O),
     _theta(lambda t: t.theta_deg + 90.0)),
    ("angle 90 deg off in a plane", PLANE + " encoder-jump", (_S, _E),
     _theta(lambda t: t.theta_deg + 90.0 * in_plane(t))),
    ("angle 1 deg off in a plane", PLANE + " encoder-jump output-step", (_S, _E),
     turn(lambda t: 1.0 * in_plane(t))),
    ("one angle 0.3 deg off", ENCODER, (_S, _E), turn(lambda t: 0.3 * one_angle(t))),
    ("a plane turned over", PLANE, (_S, _A),
     _other_plane(lambda t, p: np.where(p, -t.output_V, t.output_V))),
    ("a plane 1 mV higher", STEP, (_S, _A), _other_plane(lambda t, p: t.output_V + 1e-3 * p)),
    ("a plane with 0.1 % more gain", STEP, (_S, _A),
     _other_plane(lambda t, p: t.output_V * (1.0 + 1e-3 * p))),
    ("a plane in mV", PLANE + " " + STEP, (_S, _A),
     _other_plane(lambda t, p: t.output_V * (1.0 + 999.0 * p))),
    ("a plane with a field gain of 0.7", FIELD, (_S, _A),
     column("field_T", lambda t: t.field_T * np.where(in_plane(t), 0.7, 1.0))),
    ("plane io called op", PLANE, (_S, _O), lambda t: relabelled(t, "io", "op")),
    ("half of plane ip called op", PLANE, (_S, _A), lambda t: relabelled(t, "ip", "op", 0.5)),
    ("plane io called level", PLANE, (_S, _O), lambda t: relabelled(t, "io", "level")),
    ("planes io and op exchanged", PLANE, (_S,),
     column("plane", lambda t: np.array([{"io": "op", "op": "io"}.get(p, p) for p in t.plane]))),
    ("field and commanded field exchanged", FIELD, (_S, _F), exchanged),
    ("a copied block", "repeated-rows", (_S, _E, _A), copied),
    ("rows twice", "repeated-rows", (_S, _E), doubled),
    ("rows missing", "gap", (_S,), lost),
    ("outputs filled in", "outliers-rejected misfit", (_S, _A), filled),
    ("outputs mixed up", "outliers-rejected", (_S, _A), mixed_up),
    ("cubic in the field, 3 %", MISFIT, (_S, _P),
     output(lambda t: 0.03 * TRUTH["Km"] * t.field_T * (t.field_T / 0.05) ** 2)),
    ("iron saturates above 30 mT", MISFIT, (_S, _A),
     output(lambda t: -0.02 * np.sign(t.field_T) * np.maximum(np.abs(t.field_T) - 0.03, 0.0))),
    ("scale differs by sign, 50 ppm", MISFIT, (_S, _E, _A),
     output(lambda t: 5e-5 * np.abs(t.axes()[0]))),
    ("scale differs by the field's sign, 50 ppm", MISFIT, (_S, _E, _P),
     output(lambda t: 5e-5 * t.axes()[0] * np.sign(t.field_commanded_T))),
    ("scale differs by the field's size, 50 ppm", MISFIT, (_S, _E, _P),
     output(lambda t: 1e-3 * t.axes()[0] * np.abs(t.field_commanded_T))),
    ("a dead zone of 20 mV", MISFIT, (_S, _E), output(lambda t: -np.clip(t.output_V, -0.02, 0.02))),
    ("fifth order of the input, 50 uV", MISFIT, (_S, _A),
     output(lambda t: 50e-6 * t.axes()[0] ** 5)),
    ("sensitivity drifts 10 %", MISFIT, (_S, _A),
     output(lambda t: 0.1 * TRUTH["Km"] * t.field_T * (np.linspace(0.0, 1.0, len(t)) - 0.5))),
    ("sensitivity gone from a row on", STEP, (_S, _A),
     output(lambda t: -after(t) * TRUTH["Km"] * t.field_T)),
    ("noise ten times as large in a plane", "uneven-noise", (_S, _A),
     output(lambda t: 30e-6 * in_plane(t) * t.generator.standard_normal(len(t)))),
    ("noise grows to ten times", "uneven-noise", (_S, _P), output(_quiet)),
    ("warm-up of 500 uV", "drift-removed", (_P, _A, _E),
     output(lambda t: 500e-6 * np.exp(-np.arange(len(t)) / (0.05 * len(t))))),
    ("scale warms up by 100 ppm", "drift-removed", (_A, _S),
     output(lambda t: 1e-4 * t.axes()[0] * np.exp(-np.arange(len(t)) / (0.2 * len(t))))),
    ("first rows before the device settled", "outliers-rejected output-step", (_S, _O),
     output(lambda t: -0.3 * (np.arange(len(t)) < 3))),
)
# fmt: on

SHOWN_BY_PATTERN = ("frozen", "copied", "twice", "missing")
"""Shown by repeated or missing readings, which the residuals of a model need not show."""

FAULTS = [
    _fault(name, flags, kind, plant, True if any(w in name for w in SHOWN_BY_PATTERN) else None)
    for name, flags, kinds, plant in _PLANTED
    for kind in kinds
]
