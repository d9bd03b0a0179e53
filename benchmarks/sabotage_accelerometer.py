"""Faults of the accelerometer's magnetic sensitivity, each a change of a table's columns."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from accelerometer_records import TRUTH
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
    made,
)
from sabotage import Fault
from sabotage_accelerometer_changes import (
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
