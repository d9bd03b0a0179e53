"""Faults of records of a gyro's bias over temperature."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from bias_records import INTERVAL_S, LATITUDE_RAD, Gyro, record, truths
from static_records import true_squares

from campaigns.planted.judging import (
    Array,
    Fault,
    Held,
    Key,
    Row,
    Sample,
    but,
    example,
    refusals,
    row,
)
from campaigns.planted.logs import (
    Change,
    Kind,
    Log,
    OfColumn,
    column,
    copied,
    derivatives,
    exchanged,
    faults,
    frozen,
    in_steps,
    limited,
    lost,
    noisy,
    offset,
    ramped,
    set_at,
    settling,
    shifted,
    spikes,
    stated,
    stepped,
    times,
    together,
    waved,
    whitened,
    wild,
)
from procedures.gyro_bias_temperature.analysis import TemperatureAnalysis, analyse
from procedures.gyro_bias_temperature.dataset import TemperatureDataset

USUAL_FLAGS: frozenset[str] = frozenset()


def made(gyro: Gyro, seed: int) -> Held:
    """Return a record of a gyro."""
    dataset = record(gyro, seed)

    def off_u(analysis: TemperatureAnalysis) -> float:
        true = truths(gyro, dataset)
        return max(
            (
                abs(one.value - true[one.name]) / one.standard_uncertainty
                for one in analysis.estimates
                if one.value is not None and one.standard_uncertainty
            ),
            default=0.0,
        )

    return Held(dataset, analyse, off_u)


def of(gyro: Gyro) -> Callable[[int], Held]:
    """Return the maker of records of a gyro."""
    return partial(made, gyro)


def multiplied(factor: float) -> Callable[[TemperatureDataset, int], TemperatureDataset]:
    """Return the change of an output that is a multiple of what it should be."""
    return lambda one, _: replace(one, rate_deg_per_h=factor * one.rate_deg_per_h)


def rows_of(change: Callable[[Array], Array]) -> Callable[..., TemperatureDataset]:
    """Return the change of the output (n, 1)."""
    return lambda one, _: replace(one, rate_deg_per_h=change(one.rate_deg_per_h.copy()))


def stuck(at: float | None, rate: Array) -> Array:
    """Return an output that stands for 40 rows, at a value or where it was."""
    rate[300:340] = rate[300] if at is None else at
    return rate


def raised(rate: Array) -> Array:
    """Return an output that steps."""
    rate[700:] += 1.0
    return rate


def wave(rate: Array) -> Array:
    """Return an output with a sine of 0.1 deg/h and five rows."""
    return np.asarray(rate + 0.1 * np.sin(0.4 * np.pi * np.arange(len(rate)))[:, None])


def column_of(name: str, change: Callable[[Array], Array]) -> Callable[..., TemperatureDataset]:
    """Return the change of a thermometer's column (n,)."""
    return lambda one, _: replace(one, **{name: change(getattr(one, name).copy())})


def at_row(value: float, readings: Array) -> Array:
    """Return readings of which one is another."""
    readings[500] = value
    return readings


def held(part: float, readings: Array) -> Array:
    """Return readings that stand for a part of them."""
    readings[400 : 400 + round(part * len(readings))] = readings[400]
    return readings


def later(rows: int, readings: Array) -> Array:
    """Return readings so many rows later."""
    place = np.clip(np.arange(len(readings)) - rows, 0, len(readings) - 1)
    return np.asarray(readings[place])


def thermometers_exchanged(one: TemperatureDataset, _: int) -> TemperatureDataset:
    """Return a dataset whose thermometers are exchanged."""
    assert one.gyro_degC is not None
    return replace(one, gyro_degC=one.chamber_degC, chamber_degC=one.gyro_degC)


def fahrenheit(readings: Array) -> Array:
    """Return temperatures in degrees Fahrenheit."""
    return np.asarray(1.8 * readings + 32.0)


def kelvin(readings: Array) -> Array:
    """Return temperatures in kelvin."""
    return np.asarray(readings + 273.15)


OWN_THERMOMETER, CHAMBER_ALONE = of(Gyro()), of(Gyro(thermometer=False))
FORMS = (("gyro_degC", OWN_THERMOMETER), ("chamber_degC", CHAMBER_ALONE))
CLEAN: Sequence[Callable[[int], Sample]] = (OWN_THERMOMETER,)
LONE_RAMP = Gyro(steps=((60, 0.2),), soak_h=0.05)
SPOILT = Gyro(spikes=(100, 700, 1100), lost=slice(400, 420))

# fmt: off
ROWS: Sequence[Row] = (
    row("one ramp, one way", of(LONE_RAMP), "not-identifiable", seeds=(1,), null="hysteresis"),
    row("a reference outside the record", of(Gyro(reference_degC=90.0)), "extrapolation",
        seeds=(1,), null="bias bias_temperature_sensitivity", known="largest_bias_slope"),
    row("no thermometer of its own", of(Gyro(thermometer=False)), "not-identifiable", seeds=(1,),
        null="chamber_lag"),
    row("a straight curve", of(Gyro(curve=(0.1, 0.1))), "lag-by-prior", seeds=(1,)),
    row("output in deg/s", but(of(Gyro()), multiplied(1.0 / 3600.0)), "contradicts-statement",
        seeds=(4,), clean=of(Gyro())),
    row("output in mdeg/h", but(of(Gyro()), multiplied(1000.0)), "contradicts-statement",
        seeds=(4,)),
    row("output reversed", but(of(Gyro()), multiplied(-1.0)), "contradicts-statement", seeds=(4,)),
    row("wild and lost rows", of(SPOILT), "outliers-rejected gap", seeds=(4,), below_u=4.0),
    row("no hysteresis", of(Gyro(hysteresis=0.0)), "not-significant", seeds=(3,), below_u=4.0),
    row("output at a limit for 40 rows", but(of(Gyro()), rows_of(partial(stuck, 400.0))),
        "overload", seeds=(4,), details={"count": 40}, below_u=4.0),
    row("output frozen for 40 rows", but(of(Gyro()), rows_of(partial(stuck, None))), "frozen",
        seeds=(4,), details={"count": 40}, below_u=4.0),
    *(row(f"output steps by 1 deg/h, {name}", but(kind, rows_of(raised)), "output-step",
        seeds=(4,), below_u=4.0)
      for name, kind in FORMS),
    row("output with a wave of 5 rows", but(of(Gyro()), rows_of(wave)), "model-too-stiff",
        seeds=(4,), others="", below_u=4.0),
    row("a record at one temperature", of(Gyro(steps=((23.5, 1.0),))), "not-identifiable",
        seeds=(1,), null="*"),
    *(row(f"a reading of {value:g} in {name}", but(kind, column_of(name, partial(at_row, value))),
        "outliers-rejected", seeds=(2,), below_u=4.0)
      for name, kind in FORMS for value in (850.0, -200.0, 40.0)),
    *(row(f"{name} frozen for {part:g}", but(kind, column_of(name, partial(held, part))),
        "frozen", seeds=(2,), below_u=4.0)
      for name, kind in FORMS for part in (0.1, 0.2)),
    *(row(f"{name} {rows} rows late", but(kind, column_of(name, partial(later, rows))),
        "contradicts-statement not-identifiable", seeds=(2,), null="*")
      for name, kind in FORMS for rows in (-30, 30)),
    *(row(f"{name} in degF", but(kind, column_of(name, fahrenheit)),
        "contradicts-statement not-identifiable", seeds=(2,), null="*")
      for name, kind in FORMS),
    *(row(f"{name} in kelvin", but(kind, column_of(name, kelvin)),
        "contradicts-statement not-identifiable", seeds=(2,), null="*")
      for name, kind in FORMS),
    row("set-points in degF", but(OWN_THERMOMETER, column_of("set_point_degC", fahrenheit)),
        "contradicts-statement", seeds=(2,), below_u=4.0),
    *(row(f"output {rows} rows late", but(OWN_THERMOMETER, rows_of(partial(later, rows))),
        "contradicts-statement", seeds=(2,))
      for rows in (-30, 30)),
    row("thermometers exchanged", but(OWN_THERMOMETER, thermometers_exchanged),
        "contradicts-statement", seeds=(2,), null="*"),
    *refusals(
        example("gyro-bias-temperature"),
        ("samples.csv", "60,soak,23,", "60,wait,23,", "no phase"),
        ("samples.csv", "120,soak,23,", "30,soak,23,", "t_s"),
        ("samples.csv", "set_point_degC,rate_deg_per_h", "set_point_degC,rate", "rate"),
    ),
)
# fmt: on

RATE, OWN, CHAMBER = "rate_deg_per_h", "gyro_temperature_degC", "chamber_temperature_degC"
SET, TIME = "set_point_degC", "t_s"
OWN_K, CHAMBER_K = 0.005, 0.03
"""The noise of the two thermometers."""
CURVE = 6
"""So many coefficients of a curve are free."""
FREE: Mapping[str, float] = {
    "rate_sensitivity": 0.01,
    "hysteresis": 0.01,
    "half_width": 0.2,
    "sensor_lag_s": 20.0,
    "chamber_lag_s": 20.0,
    "warmer": 0.02,
}
"""What else is free, and by how much it is moved."""


def log(gyro: Gyro, seed: int) -> Log:
    """Return a record as it stands in a file."""
    one = record(gyro, seed)
    columns: dict[str, Array] = {
        TIME: one.time_s + 0.5 * INTERVAL_S,
        "phase": np.where(one.soaking, "soak", "ramp"),
        SET: one.set_point_degC,
        RATE: one.rate_deg_per_h[:, 0],
    }
    own, chamber = one.gyro_degC, one.chamber_degC
    columns |= {OWN: own} if own is not None else {}
    columns[CHAMBER] = chamber
    truth: dict[Key, float] = {
        (name, "IA", None): value
        for name, value in truths(gyro, one).items()
        if gyro.thermometer or not name.endswith("_lag")
    }
    conditions = {
        "sample_interval": f"{INTERVAL_S:g} s",
        "timestamp": "interval-end",
        "latitude": f"{np.degrees(LATITUDE_RAD):.10g} deg",
        "input_axis": {"IA": {"azimuth": "0 deg", "elevation": "90 deg"}},
        "reference_temperature": f"{gyro.reference_degC:g} degC",
    }
    digits = {RATE: 4, OWN: 3, CHAMBER: 3}
    return Log("gyro-bias-temperature", "samples", columns, conditions, truth, digits)


def readings(gyro: Gyro, one: Log) -> Array:
    """Return the output, white, and the temperatures in units of their noise."""
    theta = true_squares({"Q": 0.0, "N": gyro.N, "B": gyro.B, "K": gyro.K, "pulse": 0.0})
    parts = [whitened(one.columns[RATE], theta, INTERVAL_S), one.columns[CHAMBER] / CHAMBER_K]
    if OWN in one.columns:
        parts.append(one.columns[OWN] / OWN_K)
    return np.concatenate(parts)


def kind(gyro: Gyro) -> Kind:
    """Return the records of a gyro; its curve, the lags and the rest of the model are free."""

    def free(seed: int) -> Array:
        curve = np.pad(gyro.curve, (0, CURVE - len(gyro.curve)))

        def moved(steps: Mapping[str, float]) -> Array:
            fresh = curve.copy()
            values: dict[str, Any] = {}
            for name, step in steps.items():
                if name in FREE:
                    values[name] = getattr(gyro, name) + step
                else:
                    fresh[int(name)] += step
            return readings(gyro, log(replace(gyro, curve=tuple(fresh), **values), seed))

        model = derivatives(moved, {**{str(n): 0.01 for n in range(CURVE)}, **FREE})
        base = log(gyro, seed)
        still = {name: np.zeros(len(base)) for name in (RATE, OWN, CHAMBER) if name in base.columns}
        level = readings(gyro, base.but(**{**still, CHAMBER: np.ones(len(base))}))
        model = np.column_stack((model, level))
        return np.asarray(model / np.linalg.norm(model, axis=0))

    return Kind(partial(log, gyro), partial(readings, gyro), free)


BOTH, LONE = kind(Gyro()), kind(Gyro(thermometer=False))
COOL = kind(Gyro(warmer=0.5, chamber_lag_s=1200.0))
NAMING_NOTHING = frozenset({"not-significant", "not-identifiable", "lag-by-prior"})
"""Flags that come with a fault and say nothing of it."""
WHITE = Gyro().N * 60.0 / np.sqrt(INTERVAL_S)
"""Deg/h in a row."""


def on(name: str, change: OfColumn, records: Kind = BOTH) -> tuple[Kind, Change]:
    """Return the change of a column of a record."""
    return records, column(name, change)


def with_rows(*names: str, rows: int) -> Change:
    """Return some columns that come rows too late."""
    return together(*(column(name, shifted(rows)) for name in names))


def axis(azimuth: float, elevation: float) -> Change:
    """Return the change of the stated input axis."""
    return stated(input_axis={"IA": {"azimuth": f"{azimuth} deg", "elevation": f"{elevation} deg"}})


# fmt: off
FAULTS: Sequence[Fault] = faults(
    NAMING_NOTHING,
    *((f"a temperature of {value:g}", *on(OWN, set_at(value))) for value in (850.0, -200.0, 0.0)),
    *((f"a chamber's temperature of {value:g}", *on(CHAMBER, set_at(value)))
        for value in (850.0, -200.0)),
    *((f"a temperature of {value:g}, the chamber's alone", *on(CHAMBER, set_at(value), LONE), True)
        for value in (850.0, -200.0)),
    ("a temperature off by 0.5 K", *on(OWN, wild(0.5))),
    ("ten temperatures off by 20 K", *on(OWN, wild(20.0, 10))),
    ("2 % of the temperatures at 850", *on(OWN, set_at(850.0, 0.02))),
    ("5 % of the temperatures off by 3 K", *on(OWN, offset(0.05, 3.0))),
    ("a wild output", *on(RATE, wild(5.0))),
    ("an output of 7 sigma", *on(RATE, wild(7 * WHITE))),
    ("a block of outputs off", *on(RATE, offset(0.02, 1.0))),
    ("output frozen for 5 %", *on(RATE, frozen(0.05))),
    ("output frozen for 20 %", *on(RATE, frozen(0.2))),
    *((f"thermometer frozen for {100 * share:g} %", *on(OWN, frozen(share)))
        for share in (0.05, 0.1, 0.2)),
    ("chamber's thermometer frozen for 10 %", *on(CHAMBER, frozen(0.1))),
    ("chamber's thermometer alone, frozen for 10 %", *on(CHAMBER, frozen(0.1), LONE), True),
    ("a block of outputs copied", *on(RATE, copied(0.1))),
    ("a block of temperatures copied", *on(OWN, copied(0.1))),
    ("output saturated, 5 % at each end", *on(RATE, limited(0.05))),
    ("thermometer ends at 50 degC", *on(OWN, lambda x, _: np.minimum(x, 50.0))),
    ("output in steps of 0.1 deg/h", *on(RATE, in_steps(0.1))),
    ("thermometer in steps of 1 K", *on(OWN, in_steps(1.0))),
    ("10 % of the rows missing", *(BOTH, lost(0.1, in_one=False)), True),
    ("10 % of the rows missing in one block", *(BOTH, lost(0.1, in_one=True)), True),
    ("output steps by 0.1 deg/h", *on(RATE, stepped(0.1))),
    ("thermometer steps by 1 K", *on(OWN, stepped(1.0))),
    ("spikes in 3 %", *on(RATE, spikes(0.03, 0.5))),
    ("a burst of noise", *on(RATE, noisy(0.03, 10 * WHITE))),
    ("output in deg/s", *on(RATE, times(1.0 / 3600.0)), True),
    ("output in mdeg/h", *on(RATE, times(1000.0)), True),
    ("output of the other sign", *on(RATE, times(-1.0)), True),
    ("stated down, mounted up", *(BOTH, axis(0.0, -90.0)), True),
    ("latitude off by 5 deg", *(BOTH, stated(latitude="44.9 deg")), False),
    ("thermometer in degF", *on(OWN, times(1.8, 32.0)), True),
    ("both thermometers in degF", *(BOTH, together(column(OWN, times(1.8, 32.0)),
        column(CHAMBER, times(1.8, 32.0)))), True),
    ("thermometer in K", *on(OWN, times(1.0, 273.15)), True),
    ("set points in degF", *on(SET, times(1.8, 32.0)), True),
    ("thermometer 2 K off", *on(OWN, times(1.0, 2.0)), False),
    ("thermometer's gain 3 % off", *on(OWN, times(1.03)), False),
    ("thermometers exchanged", *(BOTH, exchanged(OWN, CHAMBER)), True),
    ("thermometers exchanged, a cool gyro", *(COOL, exchanged(OWN, CHAMBER)), True),
    ("output and temperature exchanged", *(BOTH, exchanged(RATE, OWN)), True),
    *((f"temperatures {abs(rows)} rows {'late' if rows > 0 else 'early'}", *on(OWN, shifted(rows)))
        for rows in (-30, -10, 10, 30)),
    ("output 30 rows late", *on(RATE, shifted(30))),
    ("everything but the set points 30 rows late", *(BOTH, with_rows(RATE, OWN, CHAMBER, rows=30))),
    ("output drifts by 0.3 deg/h", *on(RATE, ramped(0.3))),
    ("a warm-up of 0.3 deg/h", *on(RATE, settling(0.3, 0.05))),
    ("a line of 60 rows", *on(RATE, waved(0.05, 60.0))),
    ("a line over the record", *on(RATE, waved(0.1, 1580.0))),
    ("thermometer drifts by 1 K", *on(OWN, ramped(1.0))),
    ("phases exchanged", *(BOTH, column("phase", lambda x, _: np.where(x == "soak", "ramp",
        "soak"))), True),
    ("times in half their unit", *(BOTH, together(column(TIME, times(0.5)),
        stated(sample_interval="30 s"))), False),
)
# fmt: on
