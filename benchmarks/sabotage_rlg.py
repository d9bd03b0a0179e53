"""Faults planted in laser-gyro datasets, and the flags that name them; see `sabotage.py`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rlg_worlds import (
    COUNTS,
    FAST,
    FINE_COUNTS,
    ONE,
    SLOW,
    THREE,
    TWO,
    WEAK,
    Array,
    Spoil,
    Table,
    World,
    made,
    recorded,
)
from sabotage import Fault, Made


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
    (
        "output filled by a straight line",
        ONE,
        STILL,
        part(0.3, 0.65, lambda x: np.round(np.linspace(x[0], x[-1], len(x)), 4)),
    ),
    ("output filled with its mean", ONE, STILL, part(0.5, 0.9, lambda x: 0.0 * x + x.mean())),
    ("a fifth of the samples filled with the mean", ONE, STILL, filled(0.2)),
    ("output with a dead zone", THREE, "frozen not-linear", output(dead)),
    ("a block of the output copied", ONE, STILL, copied(0.1, 0.4, 0.535, field_too=False)),
    (
        "output smoothed over 4 s",
        FAST,
        "model-too-stiff",
        output(lambda x: np.round(np.convolve(x, np.ones(40) / 40.0, "same"), 4)),
    ),
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
    (
        "field's gain drifts to half",
        ONE,
        WANDERS,
        magnetic(lambda b: b * np.linspace(1.0, 0.5, len(b))[:, None]),
    ),
    ("!rows lost, times renumbered", ONE, WANDERS, renumbered),
    ("a block of rows copied", ONE, WANDERS, copied(0.1, 0.35, 0.535, field_too=True)),
    ("!time in ms", ONE, UNLIKE, lambda table, _: replace(table, t_s=1000.0 * table.t_s)),
    ("!every second row", ONE, "gap " + DENIED, halved),
)
# What was another gyro, coil or field than in the clean dataset.
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
# What the conditions say wrongly.
STATED: Sequence[tuple[str, World, str, dict[str, Any]]] = (
    ("!stamps said to be starts", COUNTS, LAG, {"timestamp": "interval-start"}),
    (
        "!field said to be averaged over 2 s",
        FAST,
        LAG,
        {"field_timestamp": "interval-end", "field_averaging": "2 s"},
    ),
    ("!interval said to be 0.2 s", FINE_COUNTS, DENIED, {"sample_interval": "0.2 s"}),
    ("!pulse said to weigh ten times as much", FINE_COUNTS, DENIED, {"pulse_weight": "0.2 arcsec"}),
    ("!drive said to be at 0.1 Hz", ONE, UNLIKE, drive(IA=(0.1, 1.2))),
    ("!drive said to be on NA", ONE, UNLIKE, drive(NA=(0.08, 1.2))),
)


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
