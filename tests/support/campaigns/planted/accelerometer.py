"""Faults of the accelerometer's magnetic sensitivity: of a table's columns, and of records."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from accelerometer_records import SIX_FIELDS_T, TRUTH, off_in_u, record

from campaigns.planted.accelerometer_tables import (
    ASCENDING,
    EFFICIENT,
    KINDS,
    ON_OFF,
    ONE_PLANE,
    PALINDROME,
    THREE_PLANES,
    Kind,
    Plant,
    after,
    an_hour_later,
    angle,
    averaged,
    before,
    column,
    copied,
    doubled,
    exchanged,
    field_more,
    filled,
    growing_noise,
    heated,
    in_plane,
    limited,
    lost,
    made,
    mixed_up,
    one_angle,
    output,
    plane_output,
    relabelled,
    rounded,
    sign_lost,
    spikes,
    stuck,
    swapped,
    turn,
    turned,
    warm,
    warmed_unseen,
    went,
    within,
)
from campaigns.planted.judging import (
    Fault,
    Held,
    Row,
    but,
    example,
    of_fault,
    refusals,
    row,
)
from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.dataset import AccelerometerDataset, Array

USUAL_FLAGS = frozenset({"not-identifiable", "not-significant", "drift-removed"})
CLEAN = [partial(made, kind) for kind in KINDS]


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
     field_more(lambda t: 0.03 * (before(t.field_T) - t.field_T))),
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
    ("gaussmeter gain steps 2 %", FIELD, (_S, _P),
     field_more(lambda t: 0.02 * after(t) * t.field_T)),
    ("gaussmeter gain drifts 0.8 %", FIELD, (_S, _A, _P),
     field_more(lambda t: 0.008 * np.linspace(0.0, 1.0, len(t)) * t.field_T)),
    ("gaussmeter zero off 2 mT", FIELD, (_S, _E), field_more(lambda t: np.full(len(t), 2e-3))),
    ("gaussmeter zero drifts 1 mT", FIELD, (_S, _P),
     field_more(lambda t: 1e-3 * np.linspace(0.0, 1.0, len(t)))),
    ("gaussmeter noise 0.3 mT", FIELD, (_S, _P),
     field_more(lambda t: 3e-4 * t.generator.standard_normal(len(t)))),
    ("gaussmeter overranges at 35 mT", FIELD + " saturated", (_S, _A),
     limited(0.035, "field_T")),
    ("gaussmeter frozen", "frozen", (_S, _E, _A),
     column("field_T", lambda t: stuck(t, t.field_T, 0.3))),
    ("voltmeter frozen", "frozen", (_S, _E, _O),
     column("output_V", lambda t: stuck(t, t.output_V, 0.2))),
    ("voltmeter frozen for four rows", "frozen outliers-rejected", (_S, _A),
     column("output_V", lambda t: stuck(t, t.output_V, 4.5 / len(t)))),
    ("thermometer frozen", "frozen", (_P, _A), warm(lambda t: stuck(t, t.temperature_degC, 0.5))),
    ("thermometer measures the room", "drift-removed", (_P,),
     warm(lambda t: 23.0 + 0.02 * t.generator.standard_normal(len(t)))),
    ("thermometer in another unit", "", (_P,), warm(lambda t: 1.8 * t.temperature_degC + 32.0)),
    ("thermometer spikes of 3 K", "outliers-rejected", (_P, _S),
     warm(lambda t: t.temperature_degC + 3.0 * (t.generator.random(len(t)) < 0.04))),
    ("thermometer steps 2 K", "misfit contradicts-statement", (_P, _S),
     warm(lambda t: t.temperature_degC + 2.0 * after(t))),
    ("thermometer drifts 1 K", "contradicts-statement", (_S,),
     warm(lambda t: t.temperature_degC + np.linspace(0.0, 1.0, len(t)))),
    ("output clipped at 0.95 V", "saturated", (_S, _E, _O), limited(0.95)),
    ("output clipped at 0.45 V", "saturated", (_S, _A), limited(0.45)),
    ("output in steps of 1 mV", "coarse-output", (_S, _O, _E), rounded("output_V", 1e-3)),
    ("encoder in steps of 0.1 deg", ENCODER, (_S, _E),
     turn(lambda t: 0.05 * np.sin(7.0 * np.radians(t.theta_deg)))),
    ("encoder jumps 0.02 deg", ENCODER, (_S, _E), turn(lambda t: 0.02 * after(t))),
    ("encoder twice a turn, 20 arcsec", ENCODER, (_S, _A),
     turn(lambda t: np.sin(np.radians(3.0 * t.theta_deg)) / 180.0)),
    ("encoder counts 0.1 % less", ENCODER, (_S, _E), angle(lambda t: 0.999 * t.theta_deg)),
    ("encoder slips slowly by 0.1 deg", ENCODER, (_S, _E),
     turn(lambda t: 0.1 * np.linspace(0.0, 1.0, len(t)))),
    ("angle in rad", UNIT, (_S, _O), angle(lambda t: np.radians(t.theta_deg))),
    ("angle in gon", UNIT, (_S, _O), angle(lambda t: t.theta_deg / 0.9)),
    ("angle of the other sense in a plane", PLANE + " " + UNIT, (_S, _E),
     angle(lambda t: np.where(in_plane(t), -t.theta_deg, t.theta_deg))),
    ("angle 90 deg off", PLANE + " contradicts-statement", (_S, _O),
     angle(lambda t: t.theta_deg + 90.0)),
    ("angle 90 deg off in a plane", PLANE + " encoder-jump", (_S, _E),
     angle(lambda t: t.theta_deg + 90.0 * in_plane(t))),
    ("angle 1 deg off in a plane", PLANE + " encoder-jump output-step", (_S, _E),
     turn(lambda t: 1.0 * in_plane(t))),
    ("one angle 0.3 deg off", ENCODER, (_S, _E), turn(lambda t: 0.3 * one_angle(t))),
    ("a plane turned over", PLANE + " " + UNIT, (_S, _A),
     plane_output(lambda t, p: np.where(p, -t.output_V, t.output_V))),
    ("a plane 1 mV higher", STEP, (_S, _A), plane_output(lambda t, p: t.output_V + 1e-3 * p)),
    ("a plane with 0.1 % more gain", STEP, (_S, _A),
     plane_output(lambda t, p: t.output_V * (1.0 + 1e-3 * p))),
    ("a plane in mV", PLANE + " " + STEP, (_S, _A),
     plane_output(lambda t, p: t.output_V * (1.0 + 999.0 * p))),
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
    ("noise grows to ten times", "uneven-noise", (_S, _P), output(growing_noise)),
    ("warm-up of 500 uV", "drift-removed", (_P, _A, _E),
     output(lambda t: 500e-6 * np.exp(-np.arange(len(t)) / (0.05 * len(t))))),
    ("scale warms up by 100 ppm", "drift-removed", (_A, _S),
     output(lambda t: 1e-4 * t.axes()[0] * np.exp(-np.arange(len(t)) / (0.2 * len(t))))),
    ("first rows before the device settled", "outliers-rejected output-step", (_S, _O),
     output(lambda t: -0.3 * (np.arange(len(t)) < 3))),
    ("output and temperature swapped", PLANE + " misfit", (_S, _P),
     swapped("output_V", "temperature_degC")),
    ("output of the other sign from a row on", UNIT, (_S, _E, _O), turned("output_V", after)),
    ("field and its command reversed in a plane", UNIT, (_S, _E, _A),
     turned("field_T field_commanded_T", in_plane)),
    ("field and its command reversed from a row on", UNIT, (_S, _E),
     turned("field_T field_commanded_T", after)),
    ("field reversed in a plane, measured", FIELD, (_S, _E), turned("field_T", in_plane)),
    ("angle of the other sense from a row on", UNIT, (_S, _O), turned("theta_deg", after)),
    ("encoder stands still", "frozen", (_S, _E, _P), angle(lambda t: stuck(t, t.theta_deg, 0.2))),
    ("angle one mark off from a row on", ENCODER, (_S,),
     angle(lambda t: t.theta_deg + 30.0 * after(t))),
    ("output a mean of two rows", UNIT + " " + SETTLED, (_S, _E), column("output_V", averaged)),
    ("coil warms the device, 4 rows", SETTLED, (_E, _P),
     output(lambda t: 100e-6 * heated(t, 4.0))),
    ("coil warms the device, 15 rows", SETTLED, (_E, _P),
     output(lambda t: 100e-6 * heated(t, 15.0))),
    ("a plane 2 K warmer, unseen", STEP + " drift-removed", (_S, _E, _A), output(warmed_unseen)),
    ("voltmeter with another gain by its sign, 30 ppm", MISFIT, (_S, _E),
     output(lambda t: 3e-5 * np.abs(t.output_V))),
    ("field gain 2 % less in a plane", FIELD, (_S, _E, _A),
     field_more(lambda t: -0.02 * in_plane(t) * t.field_T)),
    ("clock set by an hour", "gap", (_S, _P), column("t_s", an_hour_later)),
    ("temperature in K", "", (_P,), warm(lambda t: t.temperature_degC + 273.15)),
)
# fmt: on

SHOWN_BY_PATTERN = ("frozen", "copied", "twice", "missing")
"""Shown by repeated or missing readings, which the residuals of a model need not show."""

FAULTS = [
    _fault(name, flags, kind, plant, True if any(w in name for w in SHOWN_BY_PATTERN) else None)
    for name, flags, kinds, plant in _PLANTED
    for kind in kinds
]


def held(seed: int, *plan: Any, leave_out: str = "", **more: Any) -> Held:
    """Return a record of a plan in memory; the error of one result may be left out."""

    def off_u(analysis: Any) -> float:
        off = off_in_u(analysis).items()
        return max((one for name, one in off if name != leave_out), default=0.0)

    return Held(record(seed, *plan, **more), analyse, off_u)


def of(*plan: Any, **more: Any) -> Callable[[int], Held]:
    """Return the maker of records of a plan."""
    return lambda seed: held(seed, *plan, **more)


Change = Callable[[AccelerometerDataset, int], AccelerometerDataset]
FIVE_T = (-0.04, -0.02, 0.0, 0.02, 0.04)
TWO, IN_PLANE, ALL = of(), of(("io",), 12, FIVE_T), of(("io", "ip", "op"), 12, FIVE_T)
BOTH_WAYS = of(("io", "ip"), 12, (*FIVE_T, *FIVE_T[-2::-1]))
RISE_K = np.linspace(0.0, 1.0, 54)


def changed(name: str, change: Callable[[AccelerometerDataset, Array], Any]) -> Change:
    """Return the change of a column, given the record and the column."""
    return lambda one, _: replace(one, **{name: change(one, getattr(one, name).copy())})


def up(one: AccelerometerDataset) -> Array:
    """Return +1 where the field came up to a row, -1 where it came down."""
    return np.asarray(np.sign(np.diff(one.field_commanded_T, prepend=-1.0)))


def loop(width_V: float, closed: bool) -> Change:
    """Return the hysteresis of a device, a step or a loop that closes at the largest fields."""

    def width(one: AccelerometerDataset) -> Any:
        return 1.0 - 0.5 * (one.field_commanded_T / 0.04) ** 2 if closed else 1.0

    return changed("output_V", lambda one, x: x + 0.5 * width_V * up(one) * width(one))


def magnetised(one: AccelerometerDataset, _: int) -> AccelerometerDataset:
    """Return a record whose coil has a core with hysteresis, which the gaussmeter measures."""
    more_T = 2e-4 * up(one)
    slope = TRUTH["Km"] + 2 * TRUTH["Kmm"] * one.field_T
    return replace(one, field_T=one.field_T + more_T, output_V=one.output_V + slope * more_T)


def step(row: int, size_V: float) -> Change:
    """Return the step of the output at a row."""
    return changed("output_V", lambda one, x: x + size_V * (np.arange(len(one)) >= row))


def jump(rows: slice, size_deg: float) -> Change:
    """Return the error of the encoder in some rows."""

    def more(one: AccelerometerDataset, x: Array) -> Array:
        x[rows] += size_deg
        return x

    return changed("theta_deg", more)


def warming(rise_K: float, noise_K: float = 0.004) -> Callable[[int], Held]:
    """Return the maker of records in whose course the device warms up."""

    def make(seed: int) -> Held:
        rng = np.random.default_rng([seed, 3])
        true = 25.0 + rise_K * RISE_K
        one = held(seed, temperature_degC=true, K0_per_K=30e-6, Ki_per_K=100e-6)
        noise = noise_K * rng.standard_normal(54)
        return one.but(lambda it: replace(it, temperature_degC=true + noise))

    return make


def stands_from(first: int) -> Change:
    """Return the change of a thermometer that stands still from a row on."""
    return changed("temperature_degC", lambda _, x: np.where(np.arange(54) < first, x, x[first]))


ROOM = changed(
    "temperature_degC", lambda *_: 23.0 + 0.02 * np.random.default_rng(5).standard_normal(54)
)


def sign_turns(names: str, in_io: bool) -> Change:
    """Return the change of columns to the other sign, in plane io or from row 20 on."""

    def change(one: AccelerometerDataset, _: int) -> AccelerometerDataset:
        where = one.plane == "io" if in_io else np.arange(len(one)) >= 20
        sign = np.where(where, -1.0, 1.0)
        return replace(one, **{name: sign * getattr(one, name) for name in names.split()})

    return change


def encoder_stands(one: AccelerometerDataset, _: int) -> AccelerometerDataset:
    """Return a record whose encoder, commands and all, stands still for 22 rows."""
    rows = np.arange(len(one))
    angle = np.where((rows >= 30) & (rows < 52), one.theta_deg[30], one.theta_deg)
    return replace(one, theta_deg=angle, theta_commanded_deg=angle)


def long_stay(one: AccelerometerDataset, _: int) -> AccelerometerDataset:
    """Return a record with many rows more at one angle, where the output moves with the field."""
    rows = np.arange(len(one))
    at = np.sort(np.concatenate((rows, np.tile(rows[30:35], 6))))
    noise = np.random.default_rng(0).standard_normal(len(at)) * 3e-6
    stays = some_rows(at)(one, 0)
    return replace(
        stays, output_V=stays.output_V + noise, time_s=10.0 * np.arange(len(at), dtype=np.float64)
    )


def some_rows(rows: Any) -> Change:
    """Return the change that keeps some rows, in an order."""

    def change(one: AccelerometerDataset, _: int) -> AccelerometerDataset:
        arrays = {name: x for name, x in vars(one).items() if isinstance(x, np.ndarray)}
        return replace(one, **{name: x[rows] for name, x in arrays.items()})

    return change


def to_digits(places: int, _: AccelerometerDataset, x: Array) -> Any:
    return np.round(x, places)


def overloaded(_: AccelerometerDataset, x: Array) -> Array:
    x[[3, 20, 7]] = [9.9e37, -9.9e37, np.nan]
    return x


def coarse(one: AccelerometerDataset, _: int) -> AccelerometerDataset:
    """Return a record whose readings have few digits."""
    return replace(one, output_V=np.round(one.output_V, 5), field_T=np.round(one.field_T, 5))


def no_magnetic_terms(one: AccelerometerDataset, x: Array) -> Array:
    """Return the output without Kim and Kom."""
    theta = np.radians(one.theta_deg)
    o = np.where(one.plane == "io", np.cos(theta), 0.0)
    return np.asarray(x - (TRUTH["Kom"] * o + TRUTH["Kim"] * np.sin(theta)) * one.field_T)


def spoilt(text: str) -> str:
    """Return a table with a row that is over its range, a wild one, and ten lost."""
    head, *body = text.splitlines()
    body[60] = body[60].rpartition(",")[0] + ",9.9E+37"
    cells = body[100].rpartition(",")
    body[100] = f"{cells[0]},{float(cells[2]) + 0.01}"
    del body[20:30]
    return "\n".join([head, *body, ""])


ONE_EXAMPLE, ALL_EXAMPLE = map(example, ("accelerometer-one-plane", "accelerometer-three-planes"))
SPOILT = ALL_EXAMPLE.but("samples.csv", spoilt)
STEPPED = "output-step"
ENCODERS = (
    (1, (("io", "ip"), 24), slice(100, None), 0.05),
    (0, (("io", "ip"), 24), slice(130, None), 5.0),
    (4, (("io",), 24), slice(49, None), -1.0),
    (7, (("io", "ip"), 9), slice(50, None), 0.3),
    # One angle of nine leaves least absolute residuals that fit it and not the others.
    (2, (("io",), 9), slice(6, 9), 2.0),
    (0, (("io", "ip"), 9), slice(24, 27), -0.1),
)
NAMED: Sequence[tuple[str, int, str]] = (
    ("gain step 100 ppm; efficient", 7, "output-step"),
    ("voltmeter lags 3 %; one plane", 7, "not-settled"),
    ("gaussmeter gain steps 2 %; three planes, 12 angles", 7, "field-differs-from-commanded"),
    ("mains, aliased, 40 uV; three planes, 12 angles", 7, "misfit"),
    ("voltmeter frozen; one plane", 7, "frozen"),
    ("output clipped at 0.45 V; three planes, 12 angles", 7, "saturated"),
    ("output in steps of 1 mV; one plane", 7, "coarse-output"),
    ("angle in rad; three planes, 12 angles", 7, "contradicts-statement"),
    ("angle in gon; one plane", 7, "contradicts-statement"),
    ("angle of the other sense in a plane; efficient", 7, "wrong-position"),
    ("angle 90 deg off; one plane", 7, "wrong-position"),
    ("plane io called op; one plane", 7, "wrong-position"),
    ("a copied block; efficient", 7, "repeated-rows"),
    ("cubic in the field, 3 %; three planes, 12 angles", 7, "misfit"),
    ("sensitivity gone from a row on; three planes, 12 angles", 7, "output-step"),
    ("scale warms up by 100 ppm; three planes, 12 angles", 7, "drift-removed"),
    ("noise ten times as large in a plane; three planes, 12 angles", 7, "uneven-noise"),
    ("field and its command reversed in a plane; efficient", 7, "contradicts-statement"),
    ("output of the other sign from a row on; one plane", 7, "contradicts-statement"),
    ("output a mean of two rows; efficient", 7, "contradicts-statement"),
    ("encoder stands still; efficient", 7, "frozen"),
    ("coil warms the device, 4 rows; efficient", 7, "not-settled"),
)

# fmt: off
ROWS: Sequence[Row] = (
    *(of_fault(FAULTS, *one) for one in NAMED),
    *(row(f"hysteresis of {1e6 * width_V:g} uV, {'a loop' if closed else 'a step'}",
        but(BOTH_WAYS, loop(width_V, closed)), "hysteresis", without="misfit", clean=BOTH_WAYS,
        below_u=4.5) for width_V in (10e-6, -30e-6, 200e-6) for closed in (False, True)),
    *(of_fault(FAULTS, f"{name}; three planes, 12 angles", seed, codes, others="")
        for name, seed, codes in (("cubic in the field, 3 %", 6,
        "hysteresis misfit not-identifiable"),
        ("remanence, 3 % of the last field", 0, "hysteresis misfit not-identifiable"))),
    row("hysteresis of the core, in the measured field", but(BOTH_WAYS, magnetised), seeds=(3,),
        below_u=4.5),
    row("fields up and down", BOTH_WAYS, seeds=range(12), others=USUAL_FLAGS),
    *(row(f"output step of {1e6 * size_V:g} uV", but(TWO, step(at, size_V)), STEPPED,
        seeds=(seed,)) for size_V in (20e-6, -60e-6, 200e-6) for seed, at in ((0, 12), (1, 29))),
    *(row(f"output step at row {at}, drift of {1e6 * drift_V:g} uV",
        but(of(drift_V=drift_V * np.linspace(-1.0, 1.0, 54), leave_out="K0"), step(at, 1e-4)),
        STEPPED, seeds=range(3), details={"row": (at, 1), "step_V": (100e-6, 25e-6)},
        others=USUAL_FLAGS | {"outliers-rejected"}, below_u=4.5) for at in (10, 27, 40)
        for drift_V in (0.0, 30e-6)),
    *(row(f"output step of {1e6 * size_V:g} uV in one plane",
        but(of(("io",), 24, SIX_FIELDS_T, leave_out="K0"), step(70, size_V)), STEPPED,
        seeds=range(3), without="encoder-jump", below_u=4.5) for size_V in (100e-6, -20e-6)),
    row("two planes", TWO, seeds=range(40), others=USUAL_FLAGS | {"outliers-rejected"}),
    row("a slow third order", of(drift_V=15e-6 * np.linspace(-1.0, 1.0, 54) ** 3), seeds=range(40),
        without="output-step encoder-jump"),
    *(row(f"encoder {size_deg:g} deg off from row {rows.start}",
        but(of(*plan), jump(rows, size_deg)), "encoder-jump not-identifiable", seeds=(seed,),
        # A row at which the output hardly moves with the angle cannot tell.
        details={"row": (rows.start, 3), "jump_arcsec": (3600 * size_deg, 3.0)}, others="",
        below_u=3.7) for seed, plan, rows, size_deg in ENCODERS),
    row("encoder jumps between the planes",
        but(TWO, changed("theta_deg", lambda one, x: x + np.where(one.plane == "ip", 0.5, 0.0))),
        "encoder-jump not-identifiable", seeds=(4,), others="", below_u=3.7),
    *(row(f"thermometer stands still, {rise_K:g} K", but(warming(rise_K, 0.0), stands_from(20)),
        "frozen", seeds=(4,), below_u=4.5) for rise_K in (0.3, 1.0, 3.0)),
    *(row(f"thermometer in the room, {rise_K:g} K", but(warming(rise_K), ROOM), "drift-removed",
        seeds=(4,), below_u=4.5) for rise_K in (0.3, 1.0, 3.0)),
    *(row(f"thermometer frozen from row {since}", but(warming(1.0), stands_from(since)), "frozen",
        seeds=range(6), details={"count": 54 - since, "row": since, "what": "thermometer"},
        clean=warming(1.0), below_u=4.5) for since in (0, 20)),
    row("no thermometer", but(warming(1.0), lambda one, _: replace(one, temperature_degC=None)),
        "drift-removed", seeds=range(6), details={"term": "Ki"}, below_u=4.5),
    *(row(f"thermometer to {places} digits",
        but(warming(1.0), changed("temperature_degC", partial(to_digits, places))),
        seeds=range(3 - places, 20, 3), without="frozen") for places in (3, 2, 1)),
    *(row(f"encoder zero {offset:g} arcsec off",
        of(("io", "ip", "op"), 12, FIVE_T, offset_arcsec=offset, misalignment=(3e-4, -2e-4)),
        "not-identifiable", others="", below_u=4.0) for offset in (36.0, -1800.0)),
    row("encoder zero half a degree off, two planes",
        of(("io", "ip"), 12, SIX_FIELDS_T, offset_arcsec=1800.0), "not-identifiable", seeds=(17,),
        others="", below_u=4.0),
    row("readings of few digits", but(of(("io", "ip", "op"), 12, FIVE_T, noise_V=1e-6), coarse),
        "coarse-output", seeds=range(4), without="repeated-rows frozen"),
    *(row(f"sign of {names or 'nothing'}: {said}", but(TWO, sign_turns(names, "plane" in said)),
        "contradicts-statement", seeds=(1,), says=said, details={"statement": names.split()[0]},
        null="*", clean=TWO) for names, said in (("field_T field_commanded_T",
        "has the other sign in plane io"), ("output_V", "has the other sign from row 20 "),
        ("theta_deg theta_commanded_deg", "has the other sign from row 20 "))),
    row("outputs run together",
        but(TWO, changed("output_V", lambda _, x: 0.6 * x + 0.4 * np.append(x[0], x[:-1]))),
        "contradicts-statement", seeds=(1,), says="holds about 40 % of the row before",
        details={"statement": "output_V"}, null="*"),
    *(of_fault(FAULTS, f"sign of the field lost; {plan}", 0, "contradicts-statement",
        says="without its sign", details={"statement": "field_T"}, null="*")
        for plan in ("three planes, 12 angles", "efficient", "palindrome")),
    of_fault(FAULTS, "sign of the field lost, measured; palindrome", 0, FIELD),
    of_fault(FAULTS, "scale differs by the field's sign, 50 ppm; palindrome", 0, MISFIT),
    *(row(f"fields of one sign, noise of {1e6 * noise_V:g} uV",
        of(("io", "ip"), 9, (0.0, 0.02, 0.05), noise_V=noise_V), seeds=(seed,),
        without="contradicts-statement misfit") for seed, noise_V in ((0, 3e-6), (1, 1e-3))),
    row("encoder and command stand still", but(of(("io", "ip"), 12, FIVE_T), encoder_stands),
        "frozen", seeds=(2,), below_u=4.0),
    row("a long stay at an angle", but(of(("io", "ip"), 12, FIVE_T), long_stay), seeds=(2,),
        without="frozen"),
    of_fault(FAULTS, "coil warms the device, 15 rows; efficient", 1, SETTLED, below_u=4.0),
    row("an accelerometer of 1 mV noise", of(("io", "ip", "op"), 12, FIVE_T, noise_V=1e-3),
        seeds=(3,), without="misfit", below_u=4.0),
    row("outputs over their range", but(TWO, changed("output_V", overloaded)), "overload",
        seeds=(9,), details={"count": 3, "rows": [3, 7, 20]}, below_u=3.7),
    row("a field of 1.03 of the commanded one", of(field_gain=1.03),
        "field-differs-from-commanded not-identifiable", seeds=(11,), others="", below_u=3.7),
    of_fault(FAULTS, "mains, aliased, 40 uV; two planes, ascending", 0, "periodic"),
    row("a coil that is not connected", of(field_gain=0.0), "wrong-excitation"),
    row("a square hum", of(("io", "ip"), 72, (-0.05, 0.0, 0.05),
        drift_V=20e-6 * np.sign(np.sin(np.arange(432) / 5.0))), "model-too-stiff", seeds=(13,)),
    row("eight rows", but(TWO, some_rows([0, 5, 9, 14, 20, 22, 31, 40])), "not-identifiable",
        seeds=(15,), null="*"),
    row("no rows", but(TWO, some_rows([])), "not-identifiable", seeds=(15,), null="*"),
    row("no Kim and no Kom", but(TWO, changed("output_V", no_magnetic_terms)), "not-significant",
        seeds=(16,), details={"coefficients": ["Kim", "Kom"]}),
    row("a field that was never there", but(TWO, changed("field_T", lambda _, x: 0.0 * x)),
        "not-identifiable", seeds=(18,), says="do not follow the commanded ones", null="*"),
    row("the example with rows over their range, wild and lost", lambda _: SPOILT,
        "not-identifiable overload outliers-rejected gap", details={"rows": [50]}, others="",
        below_u=1.0),
    *refusals(
        ONE_EXAMPLE,
        ("dataset.yaml", "local_gravity: 1 g", "local_gravity: 1", "local_gravity"),
        ("dataset.yaml", "local_gravity: 1 g", "local_gravity: 1 mT", "local_gravity"),
        ("dataset.yaml", "local_gravity: 1 g", "local_gravity: 50 g", "dataset.yaml:5:18: cond"),
        ("dataset.yaml", "local_gravity: 1 g", "local_gravityy: 1 g", "did you mean"),
        ("dataset.yaml", "samples: samples.csv", "sample: samples.csv", "samples"),
        ("samples.csv", "theta_deg", "theta", "theta_deg"),
        ("samples.csv", "\n10.0,io,", "\n10.0,oi,", "there is no plane 'oi'"),
        ("samples.csv", "\n20.0,io,", "\n5.0,io,", "times must rise"),
        ("samples.csv", "\n10.0,io,0.00000", "\n10.0,io,zero", "theta_deg"),
        ("samples.csv", "\n10.0,io,0.00000,0.02", "\n10.0,io,0.00000,20", "3:1: field_commanded"),
    ),
)
# fmt: on
