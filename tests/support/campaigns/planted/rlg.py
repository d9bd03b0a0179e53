"""Laser gyros in their coils: clean datasets with their truth, and the faults planted in them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rlg_records import TRUTH, analysed, off_in_u, record

from campaigns.planted.judging import (
    REFUSED,
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
from procedures.estimation.sine import legendre_columns
from procedures.rlg_magnetic_sensitivity.dataset import Segment
from procedures.rlg_magnetic_sensitivity.fitted import RlgAnalysis
from procedures.rlg_magnetic_sensitivity.frequencies import Drive
from procedures.rlg_magnetic_sensitivity.parameters import AnalysisSettings
from procedures.rlg_magnetic_sensitivity.steadiness import background, flags_of, repeated
from station.findings import Estimate, Flag

Array = NDArray[Any]

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
FAST = replace(ONE, drive={"IA": (0.2, 1.2)}, samples=2000)
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

    truth: dict[tuple[str, str | None, str | None], float] = {
        ("magnetic_sensitivity", a, None): world.sensitivity[AXES.index(a)] for a in world.drive
    }
    return Made(truth, write, data, model, noise)


def rows(table: Table, start: float, stop: float) -> slice:
    """Return the rows from one part of a record to another."""
    return slice(round(start * len(table.t_s)), round(stop * len(table.t_s)))


def output(change: Callable[[Array], Array]) -> Spoil:
    """Return what changes the gyro's column."""
    return lambda table, _: replace(table, output=change(table.output.copy()))


def magnetic(change: Callable[[Array], Array]) -> Spoil:
    """Return what changes the field's columns."""
    return lambda table, _: replace(table, field_mT=change(table.field_mT.copy()))


def part(start: float, stop: float, change: Callable[[Array], Array], of: str = "output") -> Spoil:
    """Return what changes a part of the gyro's column or of the field's."""

    def spoil(table: Table, _: np.random.Generator) -> Table:
        x, here = getattr(table, of).copy(), rows(table, start, stop)
        x[here] = change(x[here])
        return replace(table, **{of: x})

    return spoil


def still(x: Array) -> Array:
    return np.asarray(0.0 * x + x[0])


def clipped(low: float, high: float) -> Spoil:
    """Return what limits the gyro's column between two quantiles of it."""
    return output(lambda x: np.clip(x, *np.quantile(x, (low, high), method="nearest")))


def stepped(step: float) -> Spoil:
    """Return what rounds each value of the gyro's column for itself."""
    return output(lambda x: step * np.round(x / step))


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


def renumbered(table: Table, _: np.random.Generator) -> Table:
    stays = np.ones(len(table.t_s), dtype=bool)
    stays[rows(table, 0.45, 0.47)] = False
    return cut(table, stays, renumbered=True)


def halved(table: Table, _: np.random.Generator) -> Table:
    return cut(table, np.arange(len(table.t_s)) % 2 == 0, renumbered=False)


def copied(start: float, stop: float, to: float, *, field_too: bool) -> Spoil:
    """Return what writes a block of rows, times apart, over a later one."""

    def spoil(table: Table, _: np.random.Generator) -> Table:
        here, place = rows(table, start, stop), round(to * len(table.t_s))
        there = slice(place, place + here.stop - here.start)
        x, b = table.output.copy(), table.field_mT.copy()
        x[there] = x[here]
        if field_too:
            b[there] = b[here]
        return replace(table, output=x, field_mT=b)

    return spoil


def bursts(table: Table, generator: np.random.Generator) -> Table:
    """Add noise with a mean to the output where the field is high."""
    x, b = table.output.copy(), table.field_mT[:, 0]
    high = b > 0.6 * b.max()
    x[high] += 0.8 + 0.3 * generator.standard_normal(int(high.sum()))
    return replace(table, output=x)


def filled(share: float) -> Spoil:
    """Return what replaces single samples, so many of all, by the mean."""

    def spoil(table: Table, generator: np.random.Generator) -> Table:
        x = table.output.copy()
        x[generator.random(len(x)) < share] = np.round(x.mean(), 4)
        return replace(table, output=x)

    return spoil


def stretched(factor: float) -> Spoil:
    """Return what the gyro's own clock, off by this, makes of its column."""

    def change(x: Array) -> Array:
        place = np.rint(np.arange(len(x)) * factor).astype(int)
        return np.asarray(x[np.minimum(place, len(x) - 1)])

    return output(change)


def dead(x: Array) -> Array:
    """Return an output that rests where it is less than 0.1 deg/h from its median."""
    off = x - np.median(x)
    return np.asarray(np.round(np.median(x) + np.sign(off) * np.maximum(np.abs(off) - 0.1, 0.0), 4))


def coil(after_s: float, factor: float) -> Callable[[Array], Array]:
    """Return the current of a coil, over the commanded one, that changes at a time."""
    return lambda at_s: np.where(at_s < after_s, 1.0, factor)


def field_unseen(world: World) -> Callable[[int], Made]:
    """Return a maker of datasets whose field goes on where the coil is off."""

    def make(seed: int) -> Made:
        dark = recorded(
            replace(world, coil=coil(0.6 * world.samples * world.interval_s, 0.0)), seed
        )
        return made(world, seed, lambda table, _: replace(table, output=dark[0].output))

    return make


def drive(**sines: tuple[float, float]) -> dict[str, Any]:
    """Return the conditions with another drive."""
    named = {a: {"frequency": f"{f!r} Hz", "amplitude": f"{m!r} mT"} for a, (f, m) in sines.items()}
    return {"drive": named}


STILL = "frozen output-step misfit not-identifiable"
STEPS = "output-step misfit"
LAG = "quadrature-significant"
MOVES = "misfit quadrature-significant"
WANDERS = "field-wanders misfit not-identifiable"
UNLIKE = "field-differs-from-commanded contradicts-statement not-identifiable"
DENIED = "contradicts-statement"
DOUBLE = replace(THREE, drive={"IA": (0.05, 1.0), "NA": (0.1, 1.0), "LA": (0.17, 1.0)})
SUM = replace(THREE, drive={"IA": (0.05, 1.0), "NA": (0.08, 1.0), "LA": (0.13, 1.0)})
THIRD = replace(THREE, drive={"IA": (0.06, 1.0), "NA": (0.1, 1.0), "LA": (0.14, 1.0)})
QUIET = replace(ONE, walk_deg_per_sqrt_h=2e-4)
ROUNDED = replace(COUNTS, pulse_arcsec=0.0, walk_deg_per_sqrt_h=5e-4)

# What became of a file: name, gyro, flags that name it, what spoils it; "!" where rows or units
# differ and the data show it all the same.
# fmt: off
SPOILT: Sequence[tuple[str, World, str, Spoil]] = (
    ("output clipped at its upper tenth", ONE, "saturated", clipped(0.0, 0.9)),
    ("output clipped at its upper third", ONE, "saturated", clipped(0.0, 0.67)),
    ("output clipped on both sides", TWO, "saturated", clipped(0.2, 0.8)),
    ("output clipped from below, three axes", THREE, "saturated", clipped(0.3, 1.0)),
    ("counts clipped", FINE_COUNTS, "saturated", clipped(0.0, 0.75)),
    ("output in steps of 1 deg/h", ONE, "coarse-output", stepped(1.0)),
    ("output in steps of 0.5 deg/h, quiet gyro", QUIET, "coarse-output", stepped(0.5)),
    ("each interval's counts rounded for itself", ROUNDED, "coarse-output", stepped(0.4)),
    ("output stuck for a third", ONE, STILL, part(0.4, 0.73, still)),
    ("counts stuck for a third", FINE_COUNTS, STILL, part(0.6, 0.9, still)),
    ("one value in fifteen held", ONE, STILL, output(lambda x: np.repeat(x[::15], 15)[: len(x)])),
    ("output filled by a straight line", ONE, STILL,
        part(0.3, 0.65, lambda x: np.round(np.linspace(x[0], x[-1], len(x)), 4))),
    ("output filled with its mean", ONE, STILL, part(0.5, 0.9, lambda x: 0.0 * x + x.mean())),
    ("a fifth of the samples filled with the mean", ONE, STILL, filled(0.2)),
    ("output with a dead zone", THREE, "frozen not-linear", output(dead)),
    ("a block of the output copied", ONE, STILL, copied(0.1, 0.4, 0.535, field_too=False)),
    ("output smoothed over 4 s", FAST, "model-too-stiff",
        output(lambda x: np.round(np.convolve(x, np.ones(40) / 40.0, "same"), 4))),
    ("output one sample late", COUNTS, LAG, late(1)),
    ("output 0.5 s late", ONE, LAG, late(5)),
    ("output 2 s late from the middle on", ONE, MOVES, late(20, 0.5)),
    ("rows of the output lost, closed up", ONE, MOVES, lost(0.4, 0.432)),
    ("output's clock off by 0.6 %", ONE, MOVES + " frozen", stretched(0.994)),
    ("output's sign turns", ONE, STEPS, part(0.7, 1.0, lambda x: -x)),
    ("output steps by 3 deg/h", WEAK, STEPS, part(0.55, 1.0, lambda x: x + 3.0)),
    ("output steps up and down", THREE, STEPS, part(0.3, 0.52, lambda x: x + 1.5)),
    ("counts step", COUNTS, STEPS, part(0.37, 1.0, lambda x: x + 2.0)),
    ("output's gain halves", ONE, STEPS, part(0.6, 1.0, lambda x: 9.0 + 0.5 * (x - 9.0))),
    ("bursts at the field's peaks", ONE, "misfit not-linear", bursts),
    ("drop-outs to zero", ONE, "outliers-rejected", part(0.2, 0.23, lambda x: 0.0 * x)),
    ("!output in arcsec a minute", ONE, DENIED, output(lambda x: 60.0 * x)),
    ("!output in deg/s", ONE, DENIED, output(lambda x: np.round(x / 3600.0, 8))),
    ("counts since the start", COUNTS, LAG + " " + DENIED, output(np.cumsum)),
    ("field clipped at 0.83", ONE, "saturated", magnetic(lambda b: np.clip(b, -1.0, 1.0))),
    ("field stuck for a fifth", ONE, WANDERS, part(0.3, 0.5, still, "field_mT")),
    ("!field in gauss", ONE, UNLIKE, magnetic(lambda b: 10.0 * b)),
    ("!field in tesla", ONE, UNLIKE, magnetic(lambda b: 1e-3 * b)),
    ("field in gauss later on", ONE, WANDERS, part(0.6, 1.0, lambda b: 10.0 * b, "field_mT")),
    ("field's columns exchanged", THREE, UNLIKE, magnetic(lambda b: b[:, [1, 0, 2]])),
    ("field's column twice", THREE, UNLIKE, magnetic(lambda b: b[:, [0, 0, 2]])),
    ("field's sign turns", ONE, WANDERS, part(0.75, 1.0, lambda b: -b, "field_mT")),
    ("field 0.5 s late", ONE, LAG, magnetic(lambda b: np.roll(b, 5, axis=0))),
    ("field's gain drifts to half", ONE, WANDERS,
        magnetic(lambda b: b * np.linspace(1.0, 0.5, len(b))[:, None])),
    ("!rows lost, times renumbered", ONE, WANDERS, renumbered),
    ("a block of rows copied", ONE, WANDERS, copied(0.1, 0.35, 0.535, field_too=True)),
    ("!time in ms", ONE, UNLIKE, lambda table, _: replace(table, t_s=1000.0 * table.t_s)),
    ("!every second row", ONE, "gap " + DENIED, halved),
)
# fmt: on
# What was another gyro, coil or field than in the clean dataset.
# fmt: off
OTHER: Sequence[tuple[str, World, str, dict[str, Any]]] = (
    ("output behind a low pass of 1.5 s", FAST, LAG, {"lag_s": 1.5}),
    ("answer 0.3 s late", FAST, LAG, {"delay_s": 0.3}),
    ("answer with a cubic term", ONE, "not-linear", {"cubic": 0.2}),
    ("coil off for the last third", ONE, WANDERS, {"coil": coil(170.0, 0.0)}),
    ("coil at 0.8 for the last half", ONE, WANDERS, {"coil": coil(120.0, 0.8)}),
    ("!a double on another axis", DOUBLE, "lines-collide", {"bend": 1.0}),
    ("!a sum on another axis", SUM, "lines-collide", {"bend": 1.0}),
    ("!a product of third order on another axis", THIRD, "lines-collide", {"cubic": 0.2}),
)
# fmt: on
# What the conditions say wrongly.
# fmt: off
STATED: Sequence[tuple[str, World, str, dict[str, Any]]] = (
    ("!stamps said to be starts", COUNTS, LAG, {"timestamp": "interval-start"}),
    ("!field said to be averaged over 2 s", FAST, LAG,
        {"field_timestamp": "interval-end", "field_averaging": "2 s"}),
    ("!interval said to be 0.2 s", FINE_COUNTS, DENIED, {"sample_interval": "0.2 s"}),
    ("!pulse said to weigh ten times as much", FINE_COUNTS, DENIED, {"pulse_weight": "0.2 arcsec"}),
    ("!drive said to be at 0.1 Hz", ONE, UNLIKE, drive(IA=(0.1, 1.2))),
    ("!drive said to be on NA", ONE, UNLIKE, drive(NA=(0.08, 1.2))),
)
# fmt: on


def fault(name: str, world: World, flags: str, planted: Callable[[int], Made]) -> Fault:
    """Return a fault; what its name begins with says whether the data are known to show it."""
    shown = True if name.startswith("!") else None
    return Fault(name.lstrip("!"), frozenset(flags.split()), partial(made, world), planted, shown)


FAULTS: Sequence[Fault] = (
    *(fault(name, w, flags, partial(made, w, spoil=how)) for name, w, flags, how in SPOILT),
    *(fault(name, w, flags, partial(made, replace(w, **how))) for name, w, flags, how in OTHER),
    *(fault(name, w, flags, partial(made, w, **how)) for name, w, flags, how in STATED),
    fault("field goes on where the coil is off", ONE, "misfit", field_unseen(ONE)),
)
CLEAN: Sequence[Callable[[int], Made]] = tuple(
    partial(made, one) for one in (ONE, WEAK, COUNTS, FINE_COUNTS, THREE, TWO, SLOW, FAST)
)
# Chance raises the third as often as it exceeds 3 u; the others say what a clean record is like.
USUAL_FLAGS = frozenset(
    ("not-significant", "non-integer-cycles", "quadrature-significant", "drift-removed")
) | {"quantisation-beat", "outliers-rejected", "cross-axis"}


def held(segment: Segment) -> Held:
    """Return a record of IA in memory; the error is that of its sensitivity, 0.05 deg/h/mT."""

    def off_u(analysis: RlgAnalysis) -> float:
        (one,) = (one for one in analysis.estimates if one.axis == "IA")
        return off_in_u(analysis, "IA", 0.05) if one.value is not None else 0.0

    return Held(segment, analysed, off_u)


def of(**more: Any) -> Callable[[int], Held]:
    """Return the maker of records in memory."""
    return lambda seed: held(record(seed, **more))


def first(count: int) -> Callable[[Segment, int], Segment]:
    """Return the change that keeps the first samples."""
    return lambda one, _: replace(
        one,
        time_s=one.time_s[:count],
        rate_deg_per_h=one.rate_deg_per_h[:count],
        field_time_s=one.field_time_s[:count],
        field_mT=one.field_mT[:count],
    )


def field_of(change: Callable[[Segment], Any]) -> Callable[[Segment, int], Segment]:
    """Return the change of the measured field."""
    return lambda one, _: replace(one, field_mT=change(one))


def silent(noise_mT: float, one: Segment) -> Array:
    """Return a field without a line."""
    still = np.tile([0.01, -0.03, 0.02], (len(one.field_time_s), 1))
    return np.asarray(still + noise_mT * np.random.default_rng(0).standard_normal(still.shape))


def too_fast(seed: int) -> Held:
    """Return a record of a drive beyond half the gyro's sampling rate."""
    fast = record(seed, drive={"IA": Drive(0.46, 1.0)}, interval_s=1.0, cycles=92.0)
    at_s = record(seed).field_time_s
    wave = np.sin(2.0 * np.pi * 0.46 * at_s)
    field = np.column_stack((wave, 0.0 * wave, 0.0 * wave))
    return held(replace(fast, field_time_s=at_s, field_mT=field))


def wild_and_lost(one: Segment, _: int) -> Segment:
    """Return a record with four spikes, one beside another, and a gap."""
    wild = one.rate_deg_per_h.copy()
    wild[[50, 51, 900, 1400]] += [30.0, -80.0, 1e5, 9.0]
    stays = np.ones(len(wild), dtype=bool)
    stays[300:420] = False
    return replace(one, rate_deg_per_h=wild[stays], time_s=one.time_s[stays])


def driven_alike(one: Segment, _: int) -> Segment:
    """Return a record whose field on NA is that on IA."""
    together = one.field_mT.copy()
    together[:, 1] = together[:, 0] * 1.0001
    return replace(one, field_mT=together)


@dataclass(frozen=True)
class Checked:
    """What a check beside a result says."""

    flags: Sequence[Flag]
    estimates: Sequence[Estimate] = ()


def proved(check: str, one: Segment, other: Segment) -> Callable[[int], Held]:
    """Return the maker of a result and its repeat under another condition."""

    def again(segments: tuple[Segment, Segment]) -> Checked:
        first, then = map(analysed, segments)
        return Checked([*flags_of([*repeated(check, first, then, segments[1:], 3.0)])])

    return lambda _: Held((one, other), again, lambda _: 0.0)


def shaken_without_field(size_deg_per_h: float) -> Callable[[int], Held]:
    """Return the maker of records without field, with a line in the output."""

    def check(segment: Segment) -> Checked:
        return Checked([*flags_of([*background(segment, 1.0, AnalysisSettings())])])

    def make(seed: int) -> Held:
        quiet = record(seed, {"IA": 0.0}, sigma=0.02)
        hum = size_deg_per_h * np.sin(2 * np.pi * 0.1 * quiet.time_s)
        rate = quiet.rate_deg_per_h + hum
        segment = replace(quiet, drive={"IA": Drive(0.1, 0.0)}, rate_deg_per_h=rate)
        return Held(segment, check, lambda _: 0.0)

    return make


def counted_at(pulses: float) -> Callable[[int], Held]:
    """Return the maker of records in counts whose mean is so many pulses of 0.4 arcsec a second."""

    def make(seed: int) -> Held:
        segment = record(
            seed, interval_s=1.0, drive={"NA": Drive(0.16, 0.8)}, cycles=80.0, sigma=0.06
        )
        rate = segment.rate_deg_per_h
        angle = np.concatenate(([0.0], np.cumsum(rate - rate.mean() + 0.4 * pulses))) / 0.4
        counts = np.diff(np.floor(angle)) * 0.4
        whole = replace(segment, rate_deg_per_h=counts, quantum_deg_per_h=0.4)
        return Held(whole, analysed, lambda _: 0.0)

    return make


def at_limits(table: Table, _: np.random.Generator) -> Table:
    return replace(table, field_mT=np.clip(table.field_mT, -1.0, 1.0))


def named(name: str, world: World, codes: str, spoil: Spoil | None = None, **more: Any) -> Row:
    """Return the row of a world that is spoilt."""
    more = {"seeds": (5,), **more}
    return row(name, partial(made, world, spoil=spoil), codes, **more)


def spoilt(text: str) -> str:
    """Return a table with a spike and forty rows lost."""
    lines = text.splitlines()
    kept = [*lines[:700], *lines[740:]]
    time, _, *field = kept[1200].split(",")
    kept[1200] = ",".join([time, "99.0", *field])
    return "\n".join([*kept, ""])


def with_line_10(text: str, _: int) -> Written:
    """Return the example with another tenth line of its table; `4` is the fifth again."""

    def change(table: str) -> str:
        lines = table.splitlines()
        return "\n".join([*lines[:9], lines[4] if text == "4" else text, *lines[10:], ""])

    return EXAMPLE.but("samples.csv", change)


LEAN_2_DEG = np.eye(3)
LEAN_2_DEG[0, 2] = np.tan(np.radians(2.0))
SLOPE = np.linspace(-1.0, 1.0, 2100)
HUM = 0.5 * np.sign(np.sin(2.0 * np.pi * 0.031 * np.arange(2000) * 0.1))
ALIKE = {"IA": Drive(0.1, 1.0), "NA": Drive(0.1, 1.0), "LA": Drive(0.17, 1.0)}
EXAMPLE = example("rlg-one-axis")
SPIKED = EXAMPLE.but("samples.csv", spoilt)
RANGE = "outside-published-range"
NULL = "not-identifiable"

NAMED: Sequence[tuple[str, str]] = (
    ("coil at 0.8 for the last half", "field-wanders"),
    ("field goes on where the coil is off", "misfit"),
    ("field's columns exchanged", "field-differs-from-commanded not-identifiable"),
    ("output stuck for a third", "frozen misfit"),
    ("output in arcsec a minute", "contradicts-statement"),
    ("output's clock off by 0.6 %", "misfit quadrature-significant"),
    ("answer with a cubic term", "not-linear"),
    ("output's gain halves", "misfit output-step"),
    ("rows of the output lost, closed up", "misfit quadrature-significant"),
    ("a block of the output copied", "frozen misfit"),
    ("interval said to be 0.2 s", "contradicts-statement"),
    ("drive said to be on NA", "field-differs-from-commanded not-identifiable wrong-excitation"),
)

# fmt: off
ROWS: Sequence[Row] = (
    *(of_fault(FAULTS, name, seed, codes) for name, codes in NAMED for seed in (3, 4)),
    *(named(f"output at its limits, {name}", world, "saturated", clipped(low, high), says="range",
        details={"part": (0.35, 0.15)}, below_u=3.0, clean=partial(made, world))
        for name, world, low, high in (("rate", ONE, 0.0, 0.67), ("counts", FINE_COUNTS, 0.0, 0.7),
        ("three axes", THREE, 0.3, 1.0))),
    named("coil at 0.96 for the last half", replace(ONE, coil=coil(120.0, 0.96)), "field-wanders"),
    named("gaussmeter at its limits", ONE, "saturated", at_limits,
        details={"channel": "field on IA"}, below_u=3.0),
    *(named(f"output in steps of {step:g} deg/h", ONE, "coarse-output" + more, stepped(step),
        seeds=(6,), details={"step_deg_per_h": (step, 1e-6)} if not more else {}, below_u=3.0)
        for step, more in ((0.4, ""), (0.5, ""), (1.0, ""), (2.0, " not-identifiable"))),
    # Half a step of noise makes rounding harmless, and counts of an angle lose nothing.
    named("output in steps of 0.3 deg/h", ONE, "", stepped(0.3), seeds=(6,),
        without="coarse-output", below_u=3.5),
    named("counts of 0.3 arcsec", replace(FINE_COUNTS, pulse_arcsec=0.3), "", seeds=(6,),
        without="coarse-output", below_u=3.5),
    *(named(f"lines at {hertz} Hz, {axis}", replace(THREE, bend=1.0,
        drive={a: (f, 1.0) for a, f in zip(THREE.drive, hertz, strict=True)}), "lines-collide",
        seeds=(7,), says=product, details={"axis": axis}) for hertz, collides in (((0.05, 0.1,
        0.17), {"NA": "2 IA", "IA": "NA - IA"}),
        ((0.05, 0.08, 0.13), {"LA": "IA + NA", "NA": "LA - IA", "IA": "LA - NA"}),
        ((0.06, 0.1, 0.14), {"IA": "2 NA - LA", "NA": "IA", "LA": "2 NA - IA"}))
        for axis, product in collides.items()),
    named("lines that do not collide",
        replace(THREE, bend=1.0, drive={"IA": (0.07, 1.0), "NA": (0.11, 1.0), "LA": (0.17, 1.0)}),
        "", seeds=(7,), without="lines-collide"),
    *(named(f"outside the published range: {said}", world, RANGE, seeds=(8,), says=said,
        details={"axis": "IA"}) for world, said in ((replace(ONE, drive={"IA": (0.25, 1.2)}),
        "frequency of 0.25 Hz"), (replace(ONE, drive={"IA": (0.04, 1.2)}), "frequency of 0.04 Hz"),
        (replace(ONE, drive={"IA": (0.08, 2.5)}), "amplitude of 2.5 mT"),
        (replace(ONE, drive={"IA": (0.08, 0.05)}), "amplitude of 0.05 mT"),
        (replace(ONE, samples=750), "cycles"))),
    named("ten cycles", replace(ONE, samples=1250), "", seeds=(8,), without=RANGE),
    of_fault(FAULTS, "pulse said to weigh ten times as much", 1, DENIED,
        details={"statement": "pulse_weight"}),
    row("spikes and a gap", but(of(), wild_and_lost), "outliers-rejected gap", seeds=(3,),
        others="", details={"missing_samples": 120}, says="4", below_u=3.5),
    *(row(f"drift, {name}", of(cycles=21.0, drift=drift), "drift-removed", seeds=(4,), others="",
        below_u=3.5) for name, drift in (("straight", 3.0 * SLOPE),
        ("a warm-up", np.exp(-2.0 * SLOPE)), ("of third order", 2.0 * SLOPE**3 - SLOPE**2))),
    row("a square hum", of(drift=HUM), "model-too-stiff"),
    row("half a cycle too many", of(cycles=10.5, sigma=0.02), "non-integer-cycles", seeds=(2,),
        others="", below_u=3.5),
    row("a coil that leans",
        of(sensitivity={"IA": 0.05, "LA": 3.0}, cycles=50.0, coils=LEAN_2_DEG), "cross-axis"),
    row("another answer at half the field", proved("linearity", record(1, sigma=0.02),
        record(2, {"IA": 0.08}, sigma=0.02, drive={"IA": Drive(0.1, 0.5)})), "not-linear"),
    row("the same answer at half the field", proved("linearity", record(1, sigma=0.02),
        record(2, sigma=0.02, drive={"IA": Drive(0.1, 0.5)})), others=""),
    row("another answer at another frequency", proved("frequency", record(1, sigma=0.02),
        record(2, {"IA": 0.08}, sigma=0.02, drive={"IA": Drive(0.15, 1.0)})),
        "differs-with-frequency"),
    *(row(f"a line of {shaken:g} deg/h without field", shaken_without_field(shaken), codes,
        seeds=(1,), others="") for shaken, codes in ((0.0, ""), (0.05, "background-line"))),
    row("23 pulses a second", counted_at(23.0), "quantisation-beat", seeds=(5,),
        says="stands still"),
    row("no sensitivity", of(sensitivity={"IA": 0.0}), "not-significant", seeds=(1,)),
    *(row(f"no line in the field, noise of {noise_mT:g} mT",
        but(of(), field_of(partial(silent, noise_mT))), NULL, says="shows no line", null="*",
        details={"axis": "IA"}) for noise_mT in (0.0, 1e-3)),
    row("a drive beyond half the sampling rate", too_fast, NULL, says="half the sampling rate",
        null="*"),
    *(row(f"{count} samples", but(of(), first(count)), NULL, says=said, null="*")
        for count, said in ((250, "cycles"), (6, "too few"), (0, "too few"))),
    row("an output that never changes",
        but(of(), lambda one, _: replace(one, rate_deg_per_h=np.full(len(one.time_s), 9.3))), NULL,
        says="never changes", null="*"),
    row("a field of another time",
        but(of(), lambda one, _: replace(one, field_time_s=one.field_time_s + 150.0)), NULL,
        says="less than half", null="*"),
    *(row(f"axes driven alike, {axis}", but(of(sensitivity=TRUTH, drive=ALIKE), driven_alike),
        NULL, details={"axis": axis}, null="magnetic_sensitivity/IA magnetic_sensitivity/NA",
        known="magnetic_sensitivity/LA") for axis in ("IA", "NA")),
    row("the example with a spike and a gap", lambda _: SPIKED, "outliers-rejected gap",
        below_u=1.0, known="magnetic_sensitivity"),
    *refusals(
        EXAMPLE,
        ("dataset.yaml", "timestamp: interval-end", "note: x", "timestamp"),
        (
            "dataset.yaml",
            "field_timestamp: instantaneous",
            "field_timestamp: interval-end",
            "field_averaging",
        ),
        ("dataset.yaml", "gyro_output: rate", "gyro_output: counts", "pulse_weight"),
        ("dataset.yaml", "sample_interval: 0.1 s", "sample_interval: 0.1", "sample_interval"),
        ("dataset.yaml", "sample_interval: 0.1 s", "sample_intervall: 0.1 s", "did you mean"),
        ("dataset.yaml", "gyro_output: rate", "gyro_output: angle", "gyro_output"),
        ("samples.csv", "b_la_mT", "b_la", "b_la_mT"),
    ),
    *(row(f"refused: line 10 is '{text}'", partial(with_line_10, text), REFUSED,
        says=("samples.csv", ":10:")) for text in ("0.900,none,0,0,0", "4", "0.900,9.1,0,0")),
    row("refused: an empty table", lambda _: EXAMPLE.but("samples.csv", lambda _: ""), REFUSED,
        says=("samples.csv", "empty")),
    row("refused: no rows",
        lambda _: EXAMPLE.but("samples.csv", lambda text: text.splitlines()[0] + "\n"), REFUSED,
        says=("samples.csv", "no")),
)
# fmt: on
