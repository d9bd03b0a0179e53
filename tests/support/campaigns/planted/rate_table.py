"""Faults of records of a gyro on a rate table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rate_records import CASES, CONDITIONS, Gyro, Made, lines
from rate_records import made as records

from campaigns.planted.judging import (
    REFUSED,
    Array,
    Fault,
    Held,
    Key,
    Row,
    Sample,
    Written,
    but,
    by_rows,
    row,
)
from campaigns.planted.logs import (
    Change,
    Kind,
    Log,
    by_log,
    column,
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
    shifted,
    spikes,
    stated,
    stepped,
    times,
    together,
    waved,
    wild,
)
from procedures.gyro_rate_table.analysis import RateTableAnalysis, analyse
from procedures.gyro_rate_table.dataset import RateTableDataset, Record

USUAL_FLAGS = frozenset({"not-significant", "not-identifiable", "outside-published-range"})


def made(gyro: Gyro, seed: int) -> Held:
    """Return records of a gyro."""
    case = records(np.random.default_rng(seed), gyro)

    def off_u(analysis: RateTableAnalysis) -> float:
        one = analysis.estimate("scale_factor", "IA")
        if one.value is None or not one.standard_uncertainty:
            return 0.0
        return abs(one.value - case.truth["scale_factor"]) / one.standard_uncertainty

    return Held(case.dataset, analyse, off_u)


WHITE, SETTLING = partial(made, CASES["white"]), partial(made, CASES["settling"])
CLEAN: Sequence[Callable[[int], Sample]] = (WHITE, partial(made, CASES["nonlinear"]))


def late(dataset: RateTableDataset, _: int) -> RateTableDataset:
    """Return records whose outputs come one sample too late."""

    def moved(one: Record) -> Record:
        rates = np.append(one.rate_deg_per_s[:1], one.rate_deg_per_s[:-1])
        return replace(one, rate_deg_per_s=rates)

    return replace(dataset, records=tuple(map(moved, dataset.records)))


def disturbed(dataset: RateTableDataset, _: int) -> RateTableDataset:
    """Return records of which one, at -20 deg/s, is off by 3.6 deg/h."""
    fresh = [
        replace(one, rate_deg_per_s=one.rate_deg_per_s + 1e-3 * (one.commanded_deg_per_s == -20.0))
        for one in dataset.records
    ]
    return replace(dataset, records=tuple(fresh))


Cells = list[str]
SHORT = Gyro(rates=(1.0, 10.0, 50.0), repeats=1)
FILE = Written(
    {
        "dataset.yaml": CONDITIONS,
        "samples.csv": "\n".join(lines(records(np.random.default_rng(7), SHORT))) + "\n",
    },
    {("scale_factor", "IA"): (1.000085, 4e-6), ("bias", "IA"): (0.4, 0.1)},
)
REVERSED = replace(
    FILE, truth={("scale_factor", "IA"): (-1.000085, 1e-6), ("bias", "IA"): (-0.4, 0.1)}
)


def table(name: str, change: Callable[[Cells], Cells | None], codes: str, **more: Any) -> Row:
    """Return the row of a file of which each line is changed or left out."""
    base = more.pop("base", FILE)
    sample = base.but("samples.csv", by_rows(change))
    return row(name, lambda _: sample, codes, below_u=1.0, **more)


def refused(said: str, change: Callable[[Cells], Cells]) -> Row:
    """Return the row of a file whose encoder does not fit the commands."""
    return table(f"refused: {said}", change, REFUSED, says=("encoder_deg", said))


def is_at(cells: Cells, rate: str, every: int) -> bool:
    return cells[1] == rate and int(cells[2]) % every == 0


def clip(cells: Cells) -> Cells:
    return [*cells[:3], f"{np.clip(float(cells[3]), -49.9, 49.9):.7f}", cells[4]]


def angle(change: Callable[[float], float]) -> Callable[[Cells], Cells]:
    """Return the change of a line's angle."""
    return lambda r: [*r[:4], f"{change(float(r[4])) % 360:.7f}"]


# fmt: off
ROWS: Sequence[Row] = (
    row("warm-up of 2 deg/h", partial(made, Gyro(warm_up=2.0)), "drift-removed", seeds=(2,),
        below_u=4.0),
    row("a scale factor that drifts by 40 ppm", partial(made, Gyro(drift_ppm=40.0)),
        "drift-removed", says="The scale factor drifts by", seeds=(2,), below_u=4.0),
    row("a bias that warms up is no scale factor that drifts", partial(made, Gyro(warm_up=3.0)),
        "drift-removed", says="the bias drifts", seeds=(2,), below_u=4.0),
    row("outputs a sample late", but(SETTLING, late), "contradicts-statement unsteady-rate",
        seeds=(4,), details={"samples": (1.0, 0.3)}, below_u=4.0),
    row("a table that settles", SETTLING, "unsteady-rate", seeds=(4,),
        without="contradicts-statement", below_u=4.0),
    row("a record that was disturbed", but(WHITE, disturbed), "bias-wanders",
        says="at 20 deg/s in switch-on 1", seeds=(6,), clean=WHITE),
    row("no records", but(WHITE, lambda one, _: replace(one, records=())), "not-identifiable",
        null="*", seeds=(8,)),
    row("a perfect gyro", WHITE, "not-significant", says="nonlinearity", seeds=(5,), below_u=4.0),
    table("output frozen for a while", lambda r: [*r[:3], "10.0027000", r[4]] if r[1] == "10"
        and int(r[2]) % 40 < 12 else r, "frozen"),
    row("three rates", lambda _: FILE, "outside-published-range not-identifiable not-significant",
        others="", below_u=1.0, null="scale_factor_repeatability"),
    table("wild outputs", lambda r: [*r[:3], "7.5", r[4]] if is_at(r, "10", 9) else r,
        "outliers-rejected"),
    table("wild angles", lambda r: [*r[:4], "123.4"] if is_at(r, "10", 50) else r,
        "outliers-rejected"),
    table("rows lost", lambda r: None if is_at(r, "-10", 7) else r, "gap"),
    table("a record lost", lambda r: None if r[1] == "-10" else r, "one-sense-only"),
    table("output at its limit", clip, "overload"),
    table("less than a turn", lambda r: None if r[1] == "1" and int(r[2]) > 320 else r,
        "part-turns"),
    table("gyro upside down", lambda r: [*r[:3], f"{-float(r[3]):.7f}", r[4]],
        "contradicts-statement", base=REVERSED),
    table("table 2 % off its rates", lambda r: [r[0], f"{float(r[1]) * 1.02:g}", *r[2:]],
        "rate-differs-from-commanded"),
    table("one sense alone", lambda r: None if r[1].startswith("-") else r, "not-identifiable",
        says="scale_factor", null="scale_factor asymmetry", known="bias"),
    table("a table that stands", lambda r: r if r[1] == "0" else None, "not-identifiable",
        null="scale_factor", known="bias"),
    table("a dead output", lambda r: [*r[:3], "0", r[4]], "contradicts-statement not-identifiable",
        null="*"),
    refused("where -1 deg/s were commanded", lambda r: [r[0], str(-float(r[1])), *r[2:]]),
    refused("turns at", lambda r: [*r[:3], r[4], r[3]]),
    refused("in deg and deg/s", angle(np.deg2rad)),
    refused("positive counter-clockwise", angle(lambda one: -one)),
    refused("in deg and deg/s", angle(lambda one: 60.0 * one)),
    refused("where 10 deg/s", lambda r: [r[0], "10" if r[1] == "50" else r[1], *r[2:]]),
)
# fmt: on

STATED = {
    "sample_interval": "1 s",
    "timestamp": "interval-end",
    "gyro_output": "rate",
    "latitude": "39.9 deg",
}
PULSE_ARCSEC = 0.01
OUTPUT, ANGLE = "rate_deg_per_s", "encoder_deg"
MEDIUM = Gyro(nonlinearity_ppm=20.0, asymmetry_ppm=15.0)
THREE_TIMES = replace(MEDIUM, scatter_ppm=3.0, repeats=3)


def log(gyro: Gyro, counts: bool, seed: int) -> Log:
    """Return the records of a gyro as they stand in a file, the angle with its turns."""
    case: Made = records(np.random.default_rng((seed, 2)), gyro)
    columns: dict[str, list[Array]] = {}
    for one in case.dataset.records:
        ends = np.concatenate((one.start_deg[:1], one.end_deg))
        rates = np.concatenate((one.rate_deg_per_s[:1], one.rate_deg_per_s))
        parts = {
            "repeat": np.full(len(ends), one.repeat),
            "commanded_deg_per_s": np.full(len(ends), one.commanded_deg_per_s),
            "t_s": one.time_s[0] - 0.5 + np.arange(len(ends)),
            "counts" if counts else OUTPUT: np.round(rates * 3600.0 / PULSE_ARCSEC)
            if counts
            else rates,
            ANGLE: ends,
        }
        for name, part in parts.items():
            columns.setdefault(name, []).append(part)
    truth: dict[Key, float] = {(name, "IA", None): one for name, one in case.truth.items()}
    digits = {OUTPUT: 7, ANGLE: 5, "counts": 0}
    stated = {**STATED, "gyro_output": "counts", "pulse_weight": f"{PULSE_ARCSEC} arcsec"}
    return Log(
        "gyro-rate-table",
        "samples",
        {name: np.concatenate(parts) for name, parts in columns.items()},
        stated if counts else STATED,
        truth,
        digits,
        frozenset({ANGLE}),
    )


def sections(one: Log) -> list[NDArray[np.int_]]:
    """Return the rows of each record."""
    repeat, rate = one.columns["repeat"], one.columns["commanded_deg_per_s"]
    new = (np.diff(repeat) != 0) | (np.diff(rate) != 0)
    return np.split(np.arange(len(one)), np.flatnonzero(new) + 1)


def readings(gyro: Gyro, counts: bool, one: Log) -> Array:
    """Return the outputs, then the angles, in units of their noise; first rows hold no output."""
    values = one.columns["counts"] * PULSE_ARCSEC / 3600.0 if counts else one.columns[OUTPUT]
    starts = [rows[0] for rows in sections(one)]
    outputs = np.delete(values * 3600.0 / (60.0 * gyro.N), starts)
    return np.concatenate((outputs, one.columns[ANGLE] / gyro.encoder_deg))


def kind(gyro: Gyro, counts: bool = False) -> Kind:
    """Return the datasets of a gyro with white noise.

    Free are, of each record, the table's angle and rate; of each switch-on the level, its ramp and
    the scale factor at each rate; the asymmetry.
    """
    make = partial(log, gyro, counts)

    def free(seed: int) -> Array:
        one = make(seed)
        repeat, rate = one.columns["repeat"], one.columns["commanded_deg_per_s"]
        time_s, size = one.columns["t_s"], 3600.0 / (60.0 * gyro.N)
        starts = [rows[0] for rows in sections(one)]

        def moved(output: Array, angle: Array) -> Array:
            return np.concatenate((np.delete(output * size, starts), angle / gyro.encoder_deg))

        nothing, columns = np.zeros(len(one)), []
        for rows in sections(one):
            own = np.isin(np.arange(len(one)), rows).astype(float)
            columns.append(moved(nothing, own))
            columns.append(moved(own, own * (time_s - time_s[rows[0]])))
        for number in np.unique(repeat):
            own = (repeat == number).astype(float)
            columns += [moved(own, nothing), moved(own * (time_s - time_s.mean()), nothing)]
            columns += [moved(own * rate * (np.abs(rate) == each), nothing) for each in gyro.rates]
        columns.append(moved(np.abs(rate), nothing))
        model = np.column_stack(columns)
        return np.asarray(model / np.linalg.norm(model, axis=0))

    return Kind(make, partial(readings, gyro, counts), free)


ONCE, THRICE, COUNTER = kind(MEDIUM), kind(THREE_TIMES), kind(MEDIUM, counts=True)
NOISE = 60.0 * MEDIUM.N / 3600.0
"""Deg/s in a sample of a second."""


def turned(change: Callable[[Array, Array, Array], Array], name: str = OUTPUT) -> Change:
    """Return the change of a column, given the commanded rates and the times of its rows."""
    return by_log(
        name, lambda x, one: change(x, one.columns["commanded_deg_per_s"], one.columns["t_s"])
    )


def part(x: Array) -> Array:
    """Return values from -1/2 to 1/2."""
    return np.asarray((x - x.min()) / np.ptp(x) - 0.5)


def per_record(name: str, change: Callable[[Array, np.random.Generator], Array]) -> Change:
    """Return the change of a column record by record."""

    def changed(one: Log, rng: np.random.Generator) -> Log:
        parts = [change(one.columns[name][rows].copy(), rng) for rows in sections(one)]
        return one.but(**{name: np.concatenate(parts)})

    return changed


def in_second(factor: float) -> Change:
    """Return the change of the scale factor in the second switch-on, which is not in the truth."""
    return by_log(OUTPUT, lambda x, one: np.where(one.columns["repeat"] == 2, factor * x, x))


def swapped(first: float, second: float) -> Change:
    """Return the exchange of the labels of two commanded rates."""

    def change(x: Array, _: np.random.Generator) -> Array:
        return np.where(x == first, second, np.where(x == second, first, x))

    return column("commanded_deg_per_s", change)


def of(change: Callable[..., Any], name: str = OUTPUT) -> Change:
    """Return the change of the output."""
    return column(name, change)


def harmonic(size_deg: float, order: int) -> Change:
    """Return an encoder with an error of an order of its angle."""
    return of(lambda a, _: a + size_deg * np.sin(order * np.radians(a)), ANGLE)


def one_record(rate: float, change: Callable[[Array], Array]) -> Change:
    """Return the change of the output at one commanded rate."""
    return turned(lambda x, w, _: np.where(w == rate, change(x), x))


# fmt: off
FAULTS: Sequence[Fault] = faults(
    USUAL_FLAGS,
    ("a wild output", ONCE, of(wild(0.5))),
    ("a wild output of 8 sigma", ONCE, of(wild(8 * NOISE))),
    ("twenty wild outputs", ONCE, of(wild(0.01, 20))),
    ("wild angles", ONCE, of(wild(20.0, 5), ANGLE)),
    ("a block of outputs off", ONCE, of(offset(0.02, 0.005))),
    ("output frozen for 5 %", ONCE, of(frozen(0.05))),
    ("output frozen for 20 %", ONCE, of(frozen(0.2))),
    ("output frozen for a fifth of each record", ONCE, per_record(OUTPUT, frozen(0.2))),
    ("angle frozen for 5 %", ONCE, of(frozen(0.05), ANGLE)),
    ("a block of outputs copied", ONCE, of(copied(0.1))),
    ("a record copied from the other sense", ONCE, turned(lambda x, w, t: np.where(w == -20.0,
        -x[w == 20.0][0], x))),
    ("saturated at 60 deg/s", ONCE, of(lambda x, _: np.clip(x, -60.0, 60.0))),
    ("saturated, 5 % at each end", ONCE, of(limited(0.05))),
    ("output in steps of 0.01 deg/s", ONCE, of(in_steps(0.01))),
    ("angle in steps of 0.1 deg", ONCE, of(in_steps(0.1), ANGLE)),
    ("5 % of the rows missing", ONCE, lost(0.05, in_one=False), True),
    ("10 % of the rows missing in one block", ONCE, lost(0.1, in_one=True), True),
    ("output steps by 3.6 deg/h", ONCE, of(stepped(1e-3))),
    ("output steps by 36 deg/h", ONCE, of(stepped(1e-2))),
    ("spikes in 2 %", ONCE, of(spikes(0.02, 0.01))),
    ("a burst of noise in 3 %", ONCE, of(noisy(0.03, 10 * NOISE))),
    ("output in rad/s", ONCE, of(times(np.pi / 180.0)), True),
    ("output in deg/h", ONCE, of(times(3600.0)), True),
    ("output in arcsec/s of counts", COUNTER, stated(pulse_weight="0.01 arcmin"), True),
    ("pulse weight 1 % off", COUNTER, stated(pulse_weight="0.0101 arcsec"), False),
    ("a sample interval of 0.5 s", ONCE, stated(sample_interval="0.5 s"), True),
    ("angle in rad", ONCE, of(times(np.pi / 180.0), ANGLE), True),
    ("angle in the other sense", ONCE, of(times(-1.0), ANGLE), True),
    ("output of the other sign", ONCE, of(times(-1.0)), True),
    ("output and angle exchanged", ONCE, exchanged(OUTPUT, ANGLE), True),
    ("10 and -10 deg/s exchanged", ONCE, swapped(10.0, -10.0), True),
    ("5 and 10 deg/s exchanged", ONCE, swapped(5.0, 10.0), True),
    ("outputs a row late", ONCE, per_record(OUTPUT, shifted(1))),
    ("outputs a row late, no table settles", THRICE, per_record(OUTPUT, shifted(1))),
    ("angles ten rows early", ONCE, of(shifted(-10), ANGLE)),
    ("stamps of interval ends called starts", ONCE, stated(timestamp="interval-start"), True),
    ("the gyro's clock 100 ppm off", ONCE, of(times(1.0001)), False),
    ("K drifts by 40 ppm", ONCE, turned(lambda x, w, t: x + 40e-6 * w * part(t))),
    ("K drifts by 40 ppm, three times", THRICE, turned(lambda x, w, t: x + 40e-6 * w * part(t))),
    ("K drifts by 200 ppm", ONCE, turned(lambda x, w, t: x + 200e-6 * w * part(t))),
    ("K settles by 40 ppm", ONCE, turned(lambda x, w, t: x + 40e-6 * w * np.exp(-t / 300.0))),
    ("K off by 50 ppm in one switch-on", THRICE, in_second(1.00005), False),
    ("K steps by 30 ppm in mid-course", ONCE, turned(lambda x, w, t: x + 30e-6 * w
        * (t > t.mean()))),
    ("bias drifts by 5 deg/h", ONCE, of(ramped(5.0 / 3600.0))),
    ("bias bends by 2 deg/h", ONCE, of(ramped(2.0 / 3600.0, 3))),
    ("a line of 300 s", ONCE, of(waved(3e-4, 300.0))),
    ("bias depends on the rate", ONCE, turned(lambda x, w, t: x + 1e-3 * (np.abs(w) > 15.0))),
    ("a cubic of 50 ppm", ONCE, turned(lambda x, w, t: x * (1.0 - 50e-6 * (w / 100.0) ** 2)),
        False),
    ("hysteresis: rising and falling rates differ", ONCE, one_record(-50.0, lambda x: x * (1.0
        + 30e-6))),
    ("one record off by 3.6 deg/h", ONCE, one_record(20.0, lambda x: x + 1e-3)),
    ("one record off by 100 ppm", ONCE, one_record(100.0, lambda x: x * 1.0001)),
    ("encoder's first harmonic of 30 arcsec", ONCE, harmonic(30.0 / 3600.0, 1)),
    ("encoder's eighth harmonic of 10 arcsec", ONCE, harmonic(10.0 / 3600.0, 8)),
    ("encoder slips by 0.05 deg", ONCE, of(lambda a, _: a + 0.05 * (np.arange(len(a)) > 700),
        ANGLE)),
    ("encoder 200 ppm too long", ONCE, of(times(1.0002), ANGLE), False),
    ("latitude of the other hemisphere", ONCE, stated(latitude="-39.9 deg"), False),
    ("latitude off by 5 deg", ONCE, stated(latitude="44.9 deg"), False),
    ("gyro upside down", ONCE, together(of(times(-1.0)), of(lambda x, _: x + 2.0 * 9.65 / 3600.0)),
        True),
    ("table turned by hand at rest", ONCE, one_record(0.0, lambda x: x + 0.01)),
    ("output zero for a while", ONCE, of(set_at(0.0, 0.01))),
)
# fmt: on
