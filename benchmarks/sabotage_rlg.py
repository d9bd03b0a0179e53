"""Laser-gyro datasets with their truth, and the faults that are planted in them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sabotage import Fault, Made

from procedures.estimation.drift import legendre_columns

Array = NDArray[np.float64]

AXES = ("IA", "NA", "LA")
FINE = (np.arange(16) + 0.5) / 16.0 - 0.5
FIELD_NOISE_MT = 3e-4


@dataclass(frozen=True)
class World:
    """One gyro in one field; rates in deg/h, fields in mT, times in s.

    `drive` maps axes to (Hz, mT); `lean` is the largest part of a coil's field on another axis;
    `delay_s` is that of the gyro's answer, `gain` (n,) what multiplies it, `coil` (times) the
    coil's current over the commanded one.
    """

    drive: Mapping[str, tuple[float, float]]
    interval_s: float
    samples: int
    sensitivity: tuple[float, float, float]
    pulse_arcsec: float = 0.0
    stamp: str = "interval-end"
    field_averaging_s: float = 0.0
    walk_deg_per_sqrt_h: float = 1e-3
    rate_walk: float = 0.0
    ramp_deg_per_h2: float = 0.0
    warm_up_deg_per_h: float = 0.0
    lean: float = 0.003
    bend: float = 0.0
    cubic: float = 0.0
    delay_s: float = 0.0
    earth_deg_per_h: float | None = None
    decimals: int = 4
    lag_s: float = 0.0
    coil: Callable[[Array], Array] = field(default=np.ones_like)


@dataclass(frozen=True)
class Table:
    """What stands in the file: stamps, the gyro's column, the field (n, 3), the conditions."""

    t_s: Array
    output: Array
    field_mT: Array
    conditions: Mapping[str, Any]


Spoil = Callable[[Table, np.random.Generator], Table]

ONE = World({"IA": (0.08, 1.2)}, 0.1, 2500, (0.3, 0.02, -0.03))
WEAK = replace(ONE, sensitivity=(0.031, 0.004, -0.003))
COUNTS = World(
    {"NA": (0.16, 0.8)}, 1.0, 500, (0.02, -0.5, 0.01), pulse_arcsec=0.4, earth_deg_per_h=9.345
)
FINE_COUNTS = World(
    {"LA": (0.1, 1.0)}, 0.1, 3000, (0.01, 0.02, 0.2), pulse_arcsec=0.02, stamp="interval-start"
)
THREE = World(
    {"IA": (0.07, 1.0), "NA": (0.11, 1.0), "LA": (0.17, 1.0)},
    0.1,
    2000,
    (0.4, -0.15, 0.22),
    lean=0.0175,
)
TWO = World({"IA": (0.1, 0.6), "LA": (0.13, 0.8)}, 0.2, 2000, (-0.2, 0.0, 0.35), lean=0.01)
SLOW = World(
    {"NA": (0.05, 2.0)},
    0.5,
    1200,
    (0.02, 0.15, 0.01),
    stamp="interval-middle",
    field_averaging_s=0.2,
    walk_deg_per_sqrt_h=2e-3,
    rate_walk=0.02,
    ramp_deg_per_h2=0.5,
    warm_up_deg_per_h=0.1,
)
STAMP = {"interval-start": 0.5, "interval-middle": 0.0, "interval-end": -0.5}


def recorded(world: World, seed: int) -> tuple[Table, Array, Array]:
    """Return the table of a world, the model (4 n, p) of its readings and their noise (4 n,)."""
    generator = np.random.default_rng([seed, 31])
    count, tau = world.samples, world.interval_s
    middle_s = (np.arange(count) + 0.5) * tau
    stamp_s = middle_s - STAMP[world.stamp] * tau
    averaging_s = world.field_averaging_s
    coils = np.eye(3) + generator.uniform(-world.lean, world.lean, (3, 3)) * (1.0 - np.eye(3))
    ambient = generator.uniform(-0.03, 0.03, 3)
    phases = generator.uniform(0.0, 2.0 * np.pi, 3)
    lines = [(AXES.index(axis), *sine) for axis, sine in world.drive.items()]

    def coil_field(k: int, f: float, size: float, at_s: Array) -> Array:
        wave = size * np.sin(2.0 * np.pi * f * at_s + phases[k]) * world.coil(at_s)
        return np.asarray(wave[..., None] * coils[k])

    def total(at_s: Array) -> Array:
        return ambient + sum(coil_field(k, f, size, at_s) for k, f, size in lines)

    slopes = np.array(world.sensitivity)
    seen = total(middle_s[:, None] + FINE * tau - world.delay_s)
    along = seen @ slopes
    answer = (along + world.bend * along**2 + world.cubic * np.sum(seen**3, axis=-1)).mean(axis=1)
    earth = world.earth_deg_per_h
    rate = (generator.uniform(6.0, 11.0) if earth is None else earth) + answer
    sigma = 60.0 * world.walk_deg_per_sqrt_h / np.sqrt(tau)
    rate = rate + sigma * generator.standard_normal(count)
    step = world.rate_walk / 60.0 * np.sqrt(tau)
    rate = rate + np.cumsum(step * generator.standard_normal(count))
    rate = rate + world.ramp_deg_per_h2 * middle_s / 3600.0
    rate = rate + world.warm_up_deg_per_h * np.exp(-middle_s / 900.0)
    if world.lag_s:
        keep = np.exp(-tau / world.lag_s)
        for n in range(1, count):
            rate[n] = keep * rate[n - 1] + (1.0 - keep) * rate[n]
    output = np.round(rate, world.decimals)
    if world.pulse_arcsec:
        angle = np.concatenate(([0.0], np.cumsum(rate) * tau)) / world.pulse_arcsec
        output = np.diff(np.floor(angle + generator.random()))
    field_mT = total(stamp_s[:, None] - averaging_s * (FINE + 0.5)).mean(axis=1)
    field_mT = field_mT + FIELD_NOISE_MT * generator.standard_normal((count, 3))
    conditions: dict[str, Any] = {
        "drive": {
            a: {"frequency": f"{f!r} Hz", "amplitude": f"{m!r} mT"}
            for a, (f, m) in world.drive.items()
        },
        "sample_interval": f"{tau!r} s",
        "timestamp": world.stamp,
        "field_timestamp": "interval-end" if averaging_s else "instantaneous",
        "gyro_output": "counts" if world.pulse_arcsec else "rate",
    }
    if averaging_s:
        conditions["field_averaging"] = f"{averaging_s!r} s"
    if world.pulse_arcsec:
        conditions["pulse_weight"] = f"{world.pulse_arcsec!r} arcsec"
    table = Table(np.round(stamp_s, 4), output, np.round(field_mT, 4), conditions)
    rounding = world.pulse_arcsec / tau if world.pulse_arcsec else 10.0**-world.decimals
    noise = np.concatenate(
        (
            np.full(count, np.hypot(sigma, rounding / np.sqrt(12.0))),
            np.full(3 * count, FIELD_NOISE_MT),
        )
    )
    return table, free_columns(world, middle_s, stamp_s, seen.mean(axis=1)), noise


def free_columns(world: World, middle_s: Array, stamp_s: Array, seen: Array) -> Array:
    """Return the derivatives of rate and field by what a clean dataset leaves free.

    Drift and ambient field, slopes and squares; each coil's sine on each axis with its frequency,
    which the gyro follows.
    """
    count, slopes = len(middle_s), world.sensitivity
    nothing = np.zeros((count, 3))
    drift = legendre_columns(middle_s, 4, middle_s[0], middle_s[-1])
    columns = [(one, nothing) for one in drift.T]
    columns += [(seen[:, a] ** power, nothing) for a in range(3) for power in (1, 2)]
    for a in range(3):
        for one in drift[:, :3].T:
            columns.append((0.0 * one, np.outer(one, np.eye(3)[a])))
        for f, _ in world.drive.values():
            for turn in (0.0, 0.25):
                for slope in (0.0, 1.0):
                    rate, away = (
                        np.cos(2.0 * np.pi * (f * t + turn)) * (t / middle_s[-1]) ** slope
                        for t in (middle_s, stamp_s - 0.5 * world.field_averaging_s)
                    )
                    columns.append((slopes[a] * rate, np.outer(away, np.eye(3)[a])))
    return np.column_stack([np.concatenate((rate, away.T.ravel())) for rate, away in columns])


def made(world: World, seed: int, spoil: Spoil | None = None, **wrong: Any) -> Made:
    """Return a dataset of a world, its table spoilt and its conditions replaced where given."""
    table, model, noise = recorded(world, seed)
    if spoil is not None:
        table = spoil(table, np.random.default_rng([seed, 32]))
    conditions = {**table.conditions, **wrong}
    weight = world.pulse_arcsec / world.interval_s if world.pulse_arcsec else 1.0
    data = np.concatenate((table.output * weight, table.field_mT.T.ravel()))

    def write(folder: Path) -> None:
        document = {
            "dataset": 1,
            "procedure": "rlg-magnetic-sensitivity",
            "files": {"samples": "samples.csv"},
            "conditions": conditions,
        }
        text = json.dumps(document, indent=1)  # JSON is YAML
        (folder / "dataset.yaml").write_text(text, encoding="utf-8")
        counts = world.pulse_arcsec > 0.0
        head = f"t_s,{'counts' if counts else 'rate_deg_per_h'},b_ia_mT,b_na_mT,b_la_mT"
        form = ["%.4f", "%d" if counts else "%.10g", *["%.7g"] * 3]
        rows = np.column_stack((table.t_s, table.output, table.field_mT))
        np.savetxt(folder / "samples.csv", rows, form, ",", header=head, comments="")

    truth = {
        ("magnetic_sensitivity", a, None): world.sensitivity[AXES.index(a)] for a in world.drive
    }
    return Made(truth, write, data, model, noise)


def rows(table: Table, start: float, stop: float) -> slice:
    """Return the rows from one part of a record to another."""
    return slice(round(start * len(table.t_s)), round(stop * len(table.t_s)))


def output(change: Callable[[Array, np.random.Generator], Array]) -> Spoil:
    """Return what changes the gyro's column."""
    return lambda table, generator: replace(table, output=change(table.output.copy(), generator))


def magnetic(change: Callable[[Array], Array]) -> Spoil:
    """Return what changes the field's columns."""
    return lambda table, _: replace(table, field_mT=change(table.field_mT.copy()))


def part(start: float, stop: float, change: Callable[[Array], Array]) -> Spoil:
    """Return what changes a part of the gyro's column."""

    def spoil(table: Table, _: np.random.Generator) -> Table:
        x, here = table.output.copy(), rows(table, start, stop)
        x[here] = change(x[here])
        return replace(table, output=x)

    return spoil


def part_of_field(start: float, stop: float, change: Callable[[Array], Array]) -> Spoil:
    """Return what changes a part of the field's columns."""

    def spoil(table: Table, _: np.random.Generator) -> Table:
        x, here = table.field_mT.copy(), rows(table, start, stop)
        x[here] = change(x[here])
        return replace(table, field_mT=x)

    return spoil


def clipped(low: float, high: float) -> Spoil:
    """Return what limits the gyro's column between two quantiles of it."""
    return output(lambda x, _: np.clip(x, *np.quantile(x, (low, high), method="nearest")))


def late(steps: int, start: float = 0.0) -> Spoil:
    """Return what moves the gyro's column against the field's from a part of the record on."""

    def spoil(table: Table, _: np.random.Generator) -> Table:
        x, here = table.output.copy(), rows(table, start, 1.0)
        x[here] = np.roll(x, steps)[here]
        return replace(table, output=x)

    return spoil


def lost(start: float, stop: float) -> Spoil:
    """Return what cuts rows out of the gyro's column and closes it up; its last rows repeat."""

    def spoil(table: Table, _: np.random.Generator) -> Table:
        x, here = table.output, rows(table, start, stop)
        closed = np.concatenate((x[: here.start], x[here.stop :]))
        return replace(table, output=np.concatenate((closed, closed[-(len(x) - len(closed)) :])))

    return spoil


def cut(table: Table, stays: NDArray[np.bool_], *, renumbered: bool) -> Table:
    """Return a table of some rows, with the times of all of them or of as many."""
    t_s = table.t_s[: int(stays.sum())] if renumbered else table.t_s[stays]
    return replace(table, t_s=t_s, output=table.output[stays], field_mT=table.field_mT[stays])


def cut_out(start: float, stop: float, *, renumbered: bool) -> Spoil:
    """Return what loses rows."""

    def spoil(table: Table, _: np.random.Generator) -> Table:
        stays = np.ones(len(table.t_s), dtype=bool)
        stays[rows(table, start, stop)] = False
        return cut(table, stays, renumbered=renumbered)

    return spoil


def copied(start: float, stop: float, to: float) -> Spoil:
    """Return what writes a block of rows, times apart, over a later one."""

    def spoil(table: Table, _: np.random.Generator) -> Table:
        here = rows(table, start, stop)
        place = round(to * len(table.t_s))
        there = slice(place, place + here.stop - here.start)
        x, b = table.output.copy(), table.field_mT.copy()
        x[there], b[there] = x[here], b[here]
        return replace(table, output=x, field_mT=b)

    return spoil


def bursts(table: Table, generator: np.random.Generator) -> Table:
    """Add bursts of large noise that last half a cycle, always at the same phase of the field."""
    x, b = table.output.copy(), table.field_mT[:, 0]
    high = b > 0.6 * b.max()
    x[high] += 0.8 + 0.3 * generator.standard_normal(int(high.sum()))
    return replace(table, output=x)


def smoothed(width: int) -> Spoil:
    """Return what averages the gyro's column over neighbours."""
    return output(lambda x, _: np.round(np.convolve(x, np.ones(width) / width, "same"), 4))


def held(every: int) -> Spoil:
    """Return what keeps one value in so many and repeats it."""
    return output(lambda x, _: np.repeat(x[::every], every)[: len(x)])


def interpolated(start: float, stop: float) -> Spoil:
    """Return what fills a part of the gyro's column by a straight line."""
    return part(start, stop, lambda x: np.round(np.linspace(x[0], x[-1], len(x)), 4))


def stretched(factor: float) -> Spoil:
    """Return what the gyro's own clock, off by this, makes of its column."""

    def change(x: Array, _: np.random.Generator) -> Array:
        place = np.arange(len(x))
        return x[np.minimum(np.rint(place * factor).astype(int), len(x) - 1)]

    return output(change)


def coil_off(after: float, factor: float) -> Callable[[Array], Array]:
    """Return the current of a coil that changes at a time in s."""
    return lambda at_s: np.where(at_s < after, 1.0, factor)


def fault(
    name: str,
    world: World,
    flags: str,
    spoil: Spoil | None = None,
    spoilt: World | None = None,
    detectable: bool | None = None,
    **wrong: Any,
) -> Fault:
    """Return a fault of the table, of the world or of the conditions; `flags` by blanks."""
    return Fault(
        name,
        frozenset(flags.split()),
        partial(made, world),
        partial(made, spoilt or world, spoil=spoil, **wrong),
        detectable,
    )


STILL = "frozen output-step misfit not-identifiable"
WANDERS = "misfit field-wanders not-identifiable"
LAG = "quadrature-significant"
UNLIKE = "field-differs-from-commanded contradicts-statement not-identifiable"
COLLIDE = replace(THREE, drive={"IA": (0.05, 1.0), "NA": (0.1, 1.0), "LA": (0.17, 1.0)})
SUMS = replace(THREE, drive={"IA": (0.05, 1.0), "NA": (0.08, 1.0), "LA": (0.13, 1.0)})
THIRDS = replace(THREE, drive={"IA": (0.06, 1.0), "NA": (0.1, 1.0), "LA": (0.14, 1.0)})
FAST = replace(ONE, drive={"IA": (0.2, 1.2)}, samples=2000)


def drive(**sines: tuple[float, float]) -> dict[str, dict[str, str]]:
    """Return the condition `drive`."""
    return {a: {"frequency": f"{f!r} Hz", "amplitude": f"{m!r} mT"} for a, (f, m) in sines.items()}


FAULTS: Sequence[Fault] = (
    # The gyro's column.
    fault("output clipped at its upper tenth", ONE, "saturated", clipped(0.0, 0.9)),
    fault("output clipped at its upper third", ONE, "saturated", clipped(0.0, 0.67)),
    fault("output clipped on both sides", ONE, "saturated", clipped(0.2, 0.8)),
    fault("output clipped from below, three axes", THREE, "saturated", clipped(0.3, 1.0)),
    fault("counts clipped", FINE_COUNTS, "saturated", clipped(0.0, 0.75)),
    fault("output in steps of 1 deg/h", ONE, "coarse-output", output(lambda x, _: np.round(x))),
    fault(
        "output in steps of 0.5 deg/h, quiet gyro",
        replace(ONE, walk_deg_per_sqrt_h=2e-4),
        "coarse-output",
        output(lambda x, _: 0.5 * np.round(2.0 * x)),
    ),
    fault(
        "each interval's counts rounded for itself",
        replace(COUNTS, pulse_arcsec=0.0, walk_deg_per_sqrt_h=5e-4),
        "coarse-output quantisation-beat",
        output(lambda x, _: 0.4 * np.round(x / 0.4)),
    ),
    fault("output stuck for a third", ONE, STILL, part(0.4, 0.73, lambda x: 0.0 * x + x[0])),
    fault("counts stuck for a third", FINE_COUNTS, STILL, part(0.6, 0.9, lambda x: 0.0 * x + x[0])),
    fault("output held, one value in fifteen", ONE, STILL + " model-too-stiff", held(15)),
    fault("output filled by a straight line", ONE, STILL, interpolated(0.3, 0.65)),
    fault("output filled with its mean", ONE, STILL, part(0.5, 0.9, lambda x: 0.0 * x + x.mean())),
    fault("output smoothed over 4 s", FAST, "model-too-stiff", smoothed(40)),
    fault("output behind a low pass of 1.5 s", FAST, LAG, spoilt=replace(FAST, lag_s=1.5)),
    fault("output one sample late", replace(COUNTS), LAG, late(1)),
    fault("output 0.5 s late", ONE, LAG, late(5)),
    fault("output 2 s late from the middle on", ONE, "misfit " + LAG, late(20, 0.5)),
    fault("rows of the output lost, closed up", ONE, "misfit " + LAG, lost(0.4, 0.432)),
    fault("output's clock off by 0.6 %", ONE, "misfit " + LAG, stretched(0.994)),
    fault("output's sign turns", ONE, "misfit output-step", part(0.7, 1.0, lambda x: -x)),
    fault(
        "output steps by 3 deg/h", WEAK, "output-step misfit", part(0.55, 1.0, lambda x: x + 3.0)
    ),
    fault(
        "output steps up and down", THREE, "output-step misfit", part(0.3, 0.52, lambda x: x + 1.5)
    ),
    fault("counts step", COUNTS, "output-step misfit", part(0.37, 1.0, lambda x: x + 2.0)),
    fault(
        "output's gain halves",
        ONE,
        "misfit output-step",
        part(0.6, 1.0, lambda x: 9.0 + 0.5 * (x - 9.0)),
    ),
    fault("bursts at the field's peaks", ONE, "misfit not-linear", bursts),
    fault("drop-outs to zero", ONE, "outliers-rejected", part(0.2, 0.23, lambda x: 0.0 * x)),
    fault(
        "output in arcsec per minute",
        ONE,
        "contradicts-statement",
        output(lambda x, _: 60.0 * x),
        detectable=True,
    ),
    fault(
        "output in deg/s",
        ONE,
        "contradicts-statement",
        output(lambda x, _: np.round(x / 3600.0, 8)),
        detectable=True,
    ),
    fault(
        "counts since the start",
        COUNTS,
        LAG + " contradicts-statement",
        output(lambda x, _: np.cumsum(x)),
    ),
    fault("response with a cubic term", ONE, "not-linear", spoilt=replace(ONE, cubic=0.2)),
    fault("answer 0.3 s late", FAST, LAG, spoilt=replace(FAST, delay_s=0.3)),
    # The field's columns and what the coils do.
    fault(
        "field clipped at 0.9", ONE, "saturated misfit", magnetic(lambda b: np.clip(b, -1.0, 1.0))
    ),
    fault(
        "field stuck for a fifth",
        ONE,
        WANDERS + " frozen outliers-rejected",
        part_of_field(0.3, 0.5, lambda b: 0.0 * b + b[0]),
    ),
    fault("field in gauss", ONE, UNLIKE, magnetic(lambda b: 10.0 * b), detectable=True),
    fault("field in tesla", ONE, UNLIKE, magnetic(lambda b: 1e-3 * b), detectable=True),
    fault(
        "field in gauss from the middle on",
        ONE,
        WANDERS + " outliers-rejected",
        part_of_field(0.6, 1.0, lambda b: 10.0 * b),
    ),
    fault("field's columns exchanged", THREE, UNLIKE, magnetic(lambda b: b[:, [1, 0, 2]])),
    fault("field's column twice", THREE, UNLIKE, magnetic(lambda b: b[:, [0, 0, 2]])),
    fault(
        "field's sign turns",
        ONE,
        WANDERS + " outliers-rejected",
        part_of_field(0.75, 1.0, lambda b: -b),
    ),
    fault("field 0.5 s late", ONE, LAG, magnetic(lambda b: np.roll(b, 5, axis=0))),
    fault(
        "field's gain drifts to half",
        ONE,
        WANDERS,
        magnetic(lambda b: b * np.linspace(1.0, 0.5, len(b))[:, None]),
    ),
    fault(
        "coil off for the last third",
        ONE,
        WANDERS + " outliers-rejected",
        spoilt=replace(ONE, coil=coil_off(170.0, 0.0)),
    ),
    fault(
        "coil at 0.8 for the last half",
        ONE,
        WANDERS,
        spoilt=replace(ONE, coil=coil_off(120.0, 0.8)),
    ),
    fault(
        "field stays where the coil is off",
        ONE,
        "misfit",
        lambda t, g: replace(
            t, output=recorded(replace(ONE, coil=coil_off(150.0, 0.0)), 0)[0].output
        ),
    ),
    # Rows and times.
    fault(
        "rows lost, times renumbered",
        ONE,
        WANDERS + " outliers-rejected",
        cut_out(0.45, 0.47, renumbered=True),
        detectable=True,
    ),
    fault("a block written twice", ONE, WANDERS + " outliers-rejected", copied(0.1, 0.35, 0.535)),
    fault(
        "time in ms",
        ONE,
        UNLIKE + " gap",
        lambda t, _: replace(t, t_s=1000.0 * t.t_s),
        detectable=True,
    ),
    fault(
        "every second row",
        ONE,
        UNLIKE + " gap",
        lambda t, _: cut(t, np.arange(len(t.t_s)) % 2 == 0, renumbered=False),
        detectable=True,
    ),
    # The conditions.
    fault(
        "stamps said to be starts",
        replace(COUNTS),
        LAG,
        timestamp="interval-start",
        detectable=True,
    ),
    fault(
        "field said to be averaged over 2 s",
        FAST,
        LAG,
        field_timestamp="interval-end",
        field_averaging="2 s",
        detectable=True,
    ),
    fault(
        "interval said to be 0.2 s",
        FINE_COUNTS,
        "contradicts-statement",
        sample_interval="0.2 s",
        detectable=True,
    ),
    fault(
        "pulse said to be ten times as heavy",
        FINE_COUNTS,
        "contradicts-statement",
        pulse_weight="0.2 arcsec",
        detectable=True,
    ),
    fault("drive said to be at 0.1 Hz", ONE, UNLIKE, drive=drive(IA=(0.1, 1.2)), detectable=True),
    fault("drive said to be on NA", ONE, UNLIKE, drive=drive(NA=(0.08, 1.2)), detectable=True),
    # What several coils at once do.
    fault(
        "a double on another axis",
        COLLIDE,
        "lines-collide",
        spoilt=replace(COLLIDE, bend=1.0),
        detectable=True,
    ),
    fault(
        "a sum on another axis",
        SUMS,
        "lines-collide",
        spoilt=replace(SUMS, bend=1.0),
        detectable=True,
    ),
    fault(
        "a product of third order on another axis",
        THIRDS,
        "lines-collide",
        spoilt=replace(THIRDS, cubic=0.2),
        detectable=True,
    ),
)

CLEAN: Sequence[Callable[[int], Made]] = tuple(
    partial(made, one) for one in (ONE, WEAK, COUNTS, FINE_COUNTS, THREE, TWO, SLOW, FAST)
)

USUAL_FLAGS = frozenset(
    (
        "not-significant",
        "non-integer-cycles",
        "drift-removed",
        "quadrature-significant",
        "quantisation-beat",
        "outliers-rejected",
        "uncalibrated",
    )
)
