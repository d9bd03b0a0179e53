"""Faults of positions of an accelerometer that gravity turns in."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from tumble_records import ARCSEC, FOUR, QUARTZ, Stage, changed
from tumble_records import made as readings

from campaigns.planted.judging import (
    REFUSED,
    Array,
    Fault,
    Held,
    Row,
    Sample,
    but,
    by_rows,
    example,
    row,
)
from campaigns.planted.logs import Change as LogChange
from campaigns.planted.logs import (
    Kind,
    Log,
    OfColumn,
    by_log,
    copied,
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
    wild,
)
from campaigns.planted.logs import column as of_column
from procedures.accelerometer_tumble.analysis import TumbleAnalysis, analyse
from procedures.accelerometer_tumble.dataset import TumbleDataset
from procedures.accelerometer_tumble.model import COEFFICIENTS

USUAL_FLAGS = frozenset({"not-identifiable", "not-significant"})
Change = Callable[[TumbleDataset, int], TumbleDataset]


def worst(analysis: TumbleAnalysis) -> float:
    """Return the largest error over u of the kept combinations; of a step K0 is left out."""
    off = [0.0]
    stepped = any(flag.code == "output-step" for flag in analysis.flags)
    for name, terms in analysis.terms.items():
        one = analysis.estimate(name)
        if one.value is None or one.standard_uncertainty is None or (stepped and name == "K0"):
            continue
        priors = np.hypot(one.sensitivities["encoder"], one.sensitivities["mounting"])
        truth = sum(share * QUARTZ.get(other, 0.0) for other, share in terms.items())
        off.append(abs(one.value - truth) / np.hypot(one.standard_uncertainty, priors))
    return float(max(off))


def made(stage: Stage, seed: int) -> Held:
    """Return the readings of a test."""
    return Held(readings(np.random.default_rng(seed), stage), analyse, worst)


BASE = partial(made, Stage())
HEAD = tuple((plane, turned, 90.0) for plane, turned, _ in FOUR)
CLEAN: Sequence[Callable[[int], Sample]] = (
    BASE,
    partial(made, Stage(mountings=FOUR[:3], positions=12)),
    partial(made, Stage(mountings=(*FOUR, *HEAD))),
)


def column(name: str, change: Callable[[Array, TumbleDataset], Array]) -> Change:
    """Return the change of a column."""
    return lambda one, _: changed(one, **{name: change(getattr(one, name).copy(), one)})


def with_rows(rows: slice | int, values: Callable[[Array], object]) -> Callable[..., Array]:
    """Return the change of some rows of a column by what the whole column holds."""

    def change(column: Array, _: TumbleDataset) -> Array:
        column[rows] = values(column)
        return column

    return change


def flag_row(name: str, change: Change, codes: str, **more: Any) -> Row:
    """Return the row of a fault of the usual test."""
    return row(name, but(BASE, change), codes, seeds=(3,), clean=BASE, **more)


def reversed_throughout(one: TumbleDataset, _: int) -> TumbleDataset:
    """Return readings whose angles count the other way."""
    return changed(one, encoder_rad=-one.encoder_rad, commanded_rad=-one.commanded_rad)


Cells = list[str]
EXAMPLE = example("accelerometer-tumble")


def refused(said: str, change: Callable[[Cells], Cells]) -> Row:
    """Return the row of the example with each row of its table changed."""
    sample = EXAMPLE.but("positions.csv", by_rows(change))
    return row(f"refused: {said}", lambda _: sample, REFUSED, says=said)


def rad(text: str) -> str:
    return f"{float(text) / 57.29578:.6f}"


# fmt: off
ROWS: Sequence[Row] = (
    row("drift", partial(made, Stage(drift_V_per_h=20e-6)), "drift-removed", below_u=3.5),
    row("warming", partial(made, Stage(warms_K=1.0)), "drift-removed", seeds=(8,), below_u=3.5),
    flag_row("four readings", lambda one, _: one.only(np.arange(len(one.time_s)) % 48 == 0),
        "not-identifiable", null="*"),
    flag_row("an angle half a turn off",
        column("encoder_rad", with_rows(20, lambda x: x[20] + np.pi)),
        "outliers-rejected contradicts-statement", below_u=3.5),
    flag_row("an output of the other sign", column("output_V", with_rows(20, lambda x: -x[20])),
        "outliers-rejected", without="contradicts-statement", below_u=3.5),
    flag_row("a wild angle", column("encoder_rad", with_rows(100, lambda x: x[100] + 30 * ARCSEC)),
        "outliers-rejected", below_u=3.5),
    flag_row("meter frozen for 15 rows",
        column("output_V", with_rows(slice(60, 75), lambda x: x[60])), "frozen",
        details={"count": 15}, below_u=3.5),
    flag_row("a mounting's outputs copied",
        column("output_V", with_rows(slice(48, 96), lambda x: x[:48])), "frozen",
        details={"count": 48}, below_u=3.5),
    flag_row("thermometer frozen",
        column("temperature_degC", lambda x, one: np.where(one.time_s > 1e3, 23.0, x)), "frozen",
        below_u=3.5),
    flag_row("output step of 50 uV",
        column("output_V", with_rows(slice(60, None), lambda x: x[60:] + 50e-6)), "output-step",
        details={"time_s": (1500.0, 0.0), "step_V": (50e-6, 5e-6)}, below_u=4.0),
    flag_row("a mounting called another plane",
        column("plane", lambda x, one: np.where(one.mounting == 1, "ip", x)),
        "contradicts-statement"),
    flag_row("a mounting called reversed",
        column("reverse", lambda x, one: np.where(one.mounting == 1, 1.0, x)),
        "output-step"),
    flag_row("outputs one row late", column("output_V", lambda x, _: np.append(x[:1], x[:-1])),
        "contradicts-statement", null="*", details={"statement": "output_V"}),
    row("seven positions", partial(made, Stage(positions=7)), "outside-published-range"),
    row("a noisy accelerometer", partial(made, Stage(noise_V=1e-3)), "not-significant",
        below_u=4.5),
    flag_row("angles of the other sense", reversed_throughout, "contradicts-statement",
        details={"statement": "theta_deg"}),
    flag_row("the encoder's fifth harmonic",
        column("encoder_rad", lambda x, _: x + 5 * ARCSEC * np.cos(5 * x)), "misfit"),
    flag_row("the scale factor warms up",
        column("output_V", lambda x, one: x + 1e-4 * np.exp(-one.time_s / 600.0)
            * np.sin(one.encoder_rad)), "model-too-stiff drift-removed"),
    flag_row("another scale factor below zero",
        column("output_V", lambda x, one: x + 30e-6 * np.abs(np.sin(one.encoder_rad))), "misfit",
        below_u=4.0),
    flag_row("clipped at 0.9 V", column("output_V", lambda x, _: np.clip(x, -0.9, 0.9)),
        "overload", below_u=4.5),
    flag_row("a temperature of 850",
        column("temperature_degC", with_rows(50, lambda x: 850.0)), "outliers-rejected",
        below_u=4.0),
    flag_row("output in mV", column("output_V", lambda x, _: 1e3 * x), "contradicts-statement",
        details={"statement": "output_V"}),
    flag_row("the first mounting but one reads 20 uV more",
        column("output_V", lambda x, one: x + 20e-6 * (one.mounting == 1)), "output-step",
        below_u=4.0),
    refused("in deg", lambda r: [*r[:4], *map(rad, r[4:6]), *r[6:]]),
    refused("of one sense", lambda r: [*r[:5], rad(r[5]), *r[6:]]),
    refused("of one sense", lambda r: [*r[:5], f"{-float(r[5]):.6f}", *r[6:]]),
    refused("in V", lambda r: [*r[:7], f"{1e3 * float(r[7]):.6f}"]),
    refused("there is no plane 'op'", lambda r: [r[0], "op", *r[2:]]),
    refused("turned about IA", lambda r: [*r[:2], "180" if r[2] == "1" else "0", *r[3:]]),
    refused("times must rise", lambda r: ["0", *r[1:]]),
)
# fmt: on

THETA, OUTPUT, HEAT = "theta_deg", "output_V", "temperature_degC"
READ_ARCSEC, HEAT_K, ORDERS = 0.3, 0.003, 3
"""How well an angle and a temperature are read; the order of a drift that is free."""


def of_terms(results: Sequence[Mapping[str, Any]]) -> float:
    """Return the largest error in u of coefficients, each with the terms that it measures."""
    return max(
        (
            abs(one["value"] - sum(share * QUARTZ.get(name, 0.0) for name, share in terms.items()))
            / one["standard_uncertainty"]
            for one in results
            if one["value"] is not None and (terms := one.get("terms"))
        ),
        default=0.0,
    )


def log(stage: Stage, seed: int) -> Log:
    """Return the readings of a test as they stand in a file."""
    one = readings(np.random.default_rng((seed, 2)), stage)
    assert one.temperature_degC is not None
    columns = {
        "t_s": one.time_s,
        "plane": one.plane,
        "reversed": (one.reverse < 0.0).astype(float),
        "head_deg": np.degrees(one.head_rad),
        "commanded_deg": np.degrees(one.commanded_rad),
        THETA: np.degrees(one.encoder_rad),
        HEAT: one.temperature_degC,
        OUTPUT: one.output_V,
    }
    conditions = {
        "local_gravity": "1 g",
        "encoder_accuracy": f"{stage.encoder_arcsec} arcsec",
        "mounting_repeatability": f"{stage.mounting_arcsec} arcsec",
    }
    digits = {THETA: 6, HEAT: 4, OUTPUT: 8}
    return Log(
        "accelerometer-tumble",
        "positions",
        columns,
        conditions,
        {},
        digits,
        further_error_u=of_terms,
    )


def seen_by(stage: Stage, one: Log) -> Array:
    """Return outputs, angles and temperatures in units of their noise."""
    angle = one.columns[THETA] * 3600.0 / READ_ARCSEC
    return np.concatenate((one.columns[OUTPUT] / stage.noise_V, angle, one.columns[HEAT] / HEAT_K))


def kind(stage: Stage) -> Kind:
    """Return the readings of a stage.

    Free are the coefficients, encoder and mountings, drift to the third order, the temperature's
    course and what it does to K0 and Ki.
    """

    def free(_: int) -> Array:
        def outputs(**changes: Any) -> Array:
            still = {"noise_V": 0.0, "encoder_arcsec": 0.0, "mounting_arcsec": 0.0}
            made_ = readings(np.random.default_rng(0), replace(stage, **{**still, **changes}))
            return np.asarray(made_.output_V)

        base = readings(np.random.default_rng(0), stage)
        theta = base.commanded_rad + base.head_rad
        drift = legendre.legvander(np.linspace(-1.0, 1.0, len(theta)), ORDERS)
        ideal = {name: outputs(truth={name: 1.0}) - outputs(truth={}) for name in COEFFICIENTS}
        slope = np.cos(theta)
        of_output = [*ideal.values(), *drift.T]
        of_output += [
            slope * wave(n * base.commanded_rad) for n in (1, 2) for wave in (np.cos, np.sin)
        ]
        of_output += [slope * (base.mounting == each) for each in np.unique(base.mounting)]
        of_output += [wave * ideal["Ki"] for wave in drift.T[1:]]
        size, nothing = len(theta), np.zeros(len(theta))
        model = [np.concatenate((one, nothing, nothing)) for one in of_output]
        model += [np.concatenate((nothing, nothing, one)) for one in drift.T]
        table = np.column_stack(model)
        assert len(table) == 3 * size
        return np.asarray(table / np.maximum(np.linalg.norm(table, axis=0), 1e-12))

    return Kind(partial(log, stage), partial(seen_by, stage), free)


WHOLE = kind(Stage(mountings=(*FOUR, *HEAD)))
USUAL = kind(Stage())
ALONE = kind(Stage(mountings=FOUR[:1]))
WARMING = kind(Stage(warms_K=1.0))
MICROVOLT = 1e-6


def of(change: OfColumn, name: str = OUTPUT) -> LogChange:
    """Return the change of the output."""
    return of_column(name, change)


def gravity(change: Callable[[Array, Array, Array], Array]) -> LogChange:
    """Return the change of the output, given the acceleration along the axis and the times."""

    def changed(x: Array, one: Log) -> Array:
        along = np.sin(np.radians(one.columns[THETA] + one.columns["head_deg"]))
        return change(x, along, one.columns["t_s"])

    return by_log(OUTPUT, changed)


def in_mounting(number: int, name: str, change: Callable[[Any], Any]) -> LogChange:
    """Return the change of a column in one mounting of 48 rows."""

    def changed(x: Any, _: np.random.Generator) -> Any:
        rows = slice(48 * number, 48 * (number + 1))
        x[rows] = change(x[rows])
        return x

    return of_column(name, changed)


def harmonic(size_arcsec: float, order: int) -> LogChange:
    """Return an encoder with an error of an order of its angle."""
    return of(lambda a, _: a + size_arcsec / 3600.0 * np.sin(order * np.radians(a)), THETA)


def backlash(size_arcsec: float) -> LogChange:
    """Return angles that the stage reaches from above otherwise than from below."""
    return of(lambda a, _: a + size_arcsec / 3600.0 * np.sign(np.gradient(a)), THETA)


def late(t: Array) -> Array:
    return np.asarray((t - t.mean()) / np.ptp(t))


# fmt: off
FAULTS: Sequence[Fault] = faults(
    USUAL_FLAGS,
    ("a wild output", USUAL, of(wild(1e-3))),
    ("a wild output of 10 sigma", USUAL, of(wild(30 * MICROVOLT))),
    ("ten wild outputs", USUAL, of(wild(100 * MICROVOLT, 10))),
    ("a wild output, one mounting", ALONE, of(wild(100 * MICROVOLT))),
    ("a wild angle", USUAL, of(wild(0.01), THETA)),
    ("a block of outputs off", USUAL, of(offset(0.04, 50 * MICROVOLT))),
    ("output frozen for 5 %", USUAL, of(frozen(0.05))),
    ("output frozen for 10 %", USUAL, of(frozen(0.1))),
    ("output frozen for 20 %", USUAL, of(frozen(0.2))),
    ("angle frozen for 5 %", USUAL, of(frozen(0.05), THETA)),
    ("thermometer frozen for 20 %", WARMING, of(frozen(0.2), HEAT)),
    ("a block of outputs copied", USUAL, of(copied(0.1))),
    ("a mounting's outputs copied", USUAL, of(lambda x, _: np.concatenate((x[:96], x[:48],
        x[144:])))),
    ("saturated at 0.999 V", USUAL, of(lambda x, _: np.clip(x, -0.999, 0.999))),
    ("saturated, 5 % at each end", USUAL, of(limited(0.05))),
    ("output in steps of 20 uV", USUAL, of(in_steps(20 * MICROVOLT))),
    ("output in steps of 1 mV", USUAL, of(in_steps(1e-3))),
    ("angle in steps of 0.01 deg", USUAL, of(in_steps(0.01), THETA)),
    ("5 % of the rows missing", USUAL, lost(0.05, in_one=False), True),
    ("a quarter of the rows missing", USUAL, lost(0.25, in_one=True), True),
    ("output steps by 10 uV", USUAL, of(stepped(10 * MICROVOLT))),
    ("output steps by 50 uV", USUAL, of(stepped(50 * MICROVOLT, 0.3))),
    ("spikes of 50 uV in 5 %", USUAL, of(spikes(0.05, 50 * MICROVOLT))),
    ("a burst of noise", USUAL, of(noisy(0.05, 30 * MICROVOLT))),
    ("output in mV", USUAL, of(times(1e3)), True),
    ("output ten times", USUAL, of(times(10.0)), False),
    ("angles in rad", USUAL, of(times(np.pi / 180.0), THETA), True),
    ("output of the other sign", USUAL, of(times(-1.0)), False),
    ("one mounting's output of the other sign", USUAL, in_mounting(2, OUTPUT, np.negative)),
    ("output and temperature exchanged", USUAL, exchanged(OUTPUT, HEAT), True),
    ("thermometer in degF", WARMING, of(times(1.8, 32.0), HEAT), False),
    ("thermometer in K", WARMING, of(times(1.0, 273.15), HEAT), False),
    ("a wild temperature", WARMING, of(wild(60.0), HEAT)),
    ("outputs a row late", USUAL, of(shifted(1))),
    ("outputs a row early", USUAL, of(shifted(-1))),
    ("plane io called ip", USUAL, of_column("plane", lambda x, _: np.where(np.arange(len(x)) < 48,
        "ip", x)), True),
    ("io and ip exchanged", USUAL, of_column("plane", lambda x, _: np.where(x == "io", "ip",
        "io")), False),
    ("a mounting called reversed", USUAL, in_mounting(0, "reversed", lambda x: 1.0 - x), True),
    ("reversed exchanged throughout", USUAL, of_column("reversed", lambda x, _: 1.0 - x), False),
    ("head of a mounting 90 deg off", WHOLE, in_mounting(5, "head_deg", lambda x: x - 90.0), True),
    ("head 0.01 deg off", WHOLE, in_mounting(5, "head_deg", lambda x: x + 0.01), True),
    ("angles of the other sense", USUAL, together(of(times(-1.0), THETA), of(times(-1.0),
        "commanded_deg")), True),
    ("fixture leans by 60 arcsec in one mounting", USUAL, in_mounting(1, THETA,
        lambda a: a + 60.0 / 3600.0)),
    ("local gravity 0.1 % off", USUAL, stated(local_gravity="1.001 g"), False),
    ("local gravity in m/s^2 as g", USUAL, stated(local_gravity="9.80665 g"), False),
    ("encoder accuracy 0.1 arcsec instead of 1", USUAL, stated(encoder_accuracy="0.1 arcsec"),
        False),
    ("encoder's first harmonic of 5 arcsec", USUAL, harmonic(5.0, 1), False),
    ("encoder's third harmonic of 5 arcsec", USUAL, harmonic(5.0, 3)),
    ("encoder's third harmonic, one mounting", ALONE, harmonic(5.0, 3)),
    ("encoder's fifth harmonic of 2 arcsec", USUAL, harmonic(2.0, 5)),
    ("backlash of 5 arcsec", USUAL, backlash(5.0)),
    ("drift of 50 uV", USUAL, of(ramped(50 * MICROVOLT))),
    ("drift of 50 uV, one mounting", ALONE, of(ramped(50 * MICROVOLT))),
    ("drift bends by 50 uV", USUAL, of(ramped(50 * MICROVOLT, 5))),
    ("warm-up of 50 uV", USUAL, of(settling(50 * MICROVOLT, 0.05))),
    ("a line of 40 rows", USUAL, of(waved(10 * MICROVOLT, 40.0))),
    ("a line of 12 rows", USUAL, of(waved(10 * MICROVOLT, 12.0))),
    ("K1 drifts by 20 ppm", USUAL, gravity(lambda x, a, t: x + 20e-6 * a * late(t))),
    ("K1 steps by 20 ppm", USUAL, gravity(lambda x, a, t: x + 20e-6 * a * (t > t.mean()))),
    ("fourth order of 20 ug", USUAL, gravity(lambda x, a, t: x + 20 * MICROVOLT * a**4)),
    ("a kink at zero of 20 ug", USUAL, gravity(lambda x, a, t: x + 20 * MICROVOLT * np.abs(a))),
    ("hysteresis of 20 uV", USUAL, by_log(OUTPUT, lambda x, one: x + 20 * MICROVOLT
        * np.sign(np.gradient(one.columns[THETA])))),
    ("times in minutes", USUAL, of(times(1.0 / 60.0), "t_s"), False),
    ("zero for a while", USUAL, of(set_at(0.0, 0.04))),
)
# fmt: on
