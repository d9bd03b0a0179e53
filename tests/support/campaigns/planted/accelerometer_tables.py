"""Tables of accelerometer data that faults are planted in, and datasets made of them.

A fault changes the columns of the recorded table, or what the device puts out. The data of a `Made`
are the output less what the true coefficients give for the recorded angle, field and temperature:
an error of any column is then an error of the output. Free in a clean dataset are the thirteen
coefficients, encoder offset, misalignment, temperature terms and a drift of third order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from accelerometer_estimator import Case
from accelerometer_records import INTERVAL_S, TRUTH, axes_g, output_V
from numpy.typing import NDArray

from campaigns.planted.judging import Made
from procedures.accelerometer_magnetic_sensitivity.model import judge

Array = NDArray[np.float64]
Generator = np.random.Generator
HEADER = "t_s,plane,theta_deg,field_commanded_T,field_T,temperature_degC,output_V"
FORMAT = "{:.1f},{},{:.5f},{:.4f},{:.6f},{:.4f},{:.8f}"
FIELD_NOISE_T = 1e-6
DRIFT_ORDER = 3


@dataclass(frozen=True)
class Kind:
    """A plan and what surrounds it: noise, drift and warming in its course, encoder, mounting."""

    plan: Case
    noise_V: float = 3e-6
    drift_V: float = 0.0
    warming_K: float = 0.02
    offset_arcsec: float = 8.0
    misaligned: tuple[float, float] = (2e-4, -3e-4)
    fields_grow: float = 1.0


@dataclass
class Table:
    """The columns of a dataset, each (rows,), and `device_V`, which a fault adds to the output."""

    kind: Kind
    t_s: Array
    plane: NDArray[np.str_]
    theta_deg: Array
    field_commanded_T: Array
    field_T: Array
    temperature_degC: Array
    output_V: Array
    generator: Generator = field(repr=False)

    def __len__(self) -> int:
        return len(self.t_s)

    def keep(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> None:
        """Keep some rows, or put them in another order; the times stay in theirs."""
        for name in HEADER.split(","):
            setattr(self, name, getattr(self, name)[rows])
        self.t_s = np.sort(self.t_s)

    def row(self, low: float = 0.3, high: float = 0.7) -> int:
        """Return a row between two parts of the record."""
        return int(self.generator.integers(int(low * len(self)), int(high * len(self))))

    def axes(self) -> tuple[Array, Array, Array]:
        """Return Ai, Ao, Ap at the recorded angle and the true offset."""
        return axes_g(self.plane, np.radians(self.theta_deg + self.kind.offset_arcsec / 3600.0))

    def warmer(self) -> Array:
        """Return the recorded temperature from its mean."""
        return np.asarray(self.temperature_degC - np.mean(self.temperature_degC))

    def predicted_V(self) -> Array:
        """Return what the true coefficients give for the recorded columns, without noise."""
        i, o, p = self.axes()
        tilted = self.kind.misaligned[0] * o + self.kind.misaligned[1] * p
        warmed = (50e-6 + 120e-6 * i) * self.warmer()
        return np.asarray(output_V(i, o, p, self.field_T) + tilted + warmed)

    def model(self) -> Array:
        """Return the columns that a clean dataset leaves free, (rows, k)."""
        i, o, p = self.axes()
        b, one, warm = self.field_T, np.ones(len(self)), self.warmer()
        turned = np.column_stack(axes_g(self.plane, np.radians(self.theta_deg) + 0.5 * np.pi))
        part = (self.t_s - self.t_s.mean()) / max(float(np.ptp(self.t_s)), 1.0)
        still = (one, i, i**2, i**3, i * o, i * p, o**2, p**2)
        magnetic = (b, b**2, i * b, o * b, p * b)
        slow = [part**n for n in range(1, DRIFT_ORDER + 1)] if self.kind.drift_V else []
        return np.column_stack((*still, *magnetic, turned[:, 0], o, p, warm, i * warm, *slow))


def table(kind: Kind, seed: int) -> Table:
    """Make a clean record."""
    generator = np.random.default_rng([seed, 17])
    plane, theta_deg, commanded_T = kind.plan.points()
    count = len(plane)
    part = np.linspace(0.0, 1.0, count)
    warm = 23.0 + kind.warming_K * (1.0 - np.exp(-3.0 * part))
    made = Table(
        kind,
        INTERVAL_S * np.arange(count, dtype=np.float64),
        plane.astype("<U8"),
        theta_deg,
        commanded_T,
        kind.fields_grow * commanded_T + FIELD_NOISE_T * generator.standard_normal(count),
        warm + 5e-4 * generator.standard_normal(count),
        np.zeros(count),
        generator,
    )
    drift = kind.drift_V * (part - 0.5 + 0.3 * (part - 0.5) ** 2)
    drift = drift - drift.mean()
    made.output_V = made.predicted_V() + drift + kind.noise_V * generator.standard_normal(count)
    return made


Plant = Callable[[Table], None]


def made(kind: Kind, seed: int, plant: Plant | None = None) -> Made:
    """Return a dataset of a kind, with a fault planted in it."""
    clean = table(kind, seed)
    found = judge(clean.plane, clean.theta_deg, clean.field_commanded_T)
    truth: dict[tuple[str, str | None, str | None], float] = {
        (name, None, None): sum((share * TRUTH[part] for part, share in terms.items()), 0.0)
        for name, terms in found.terms.items()
    }
    model = clean.model()
    if plant is not None:
        plant(clean)

    def write(folder: Path) -> None:
        text = ["dataset: 1", "procedure: accelerometer-magnetic-sensitivity"]
        text += ["files: {samples: samples.csv}", "conditions: {local_gravity: 1 g}", ""]
        (folder / "dataset.yaml").write_text("\n".join(text), encoding="utf-8")
        columns = [getattr(clean, name) for name in HEADER.split(",")]
        lines = [FORMAT.format(*row) for row in zip(*columns, strict=True)]
        (folder / "samples.csv").write_text("\n".join([HEADER, *lines, ""]), encoding="utf-8")

    noise = np.full(len(clean), kind.noise_V)
    return Made(truth, write, clean.output_V - clean.predicted_V(), model, noise)


TWO_SIDED = (-0.05, 0.0, 0.05)
FIVE = (-0.04, -0.02, 0.0, 0.02, 0.04)
THREE_PLANES = Kind(Case("three planes, 12 angles", angles=12, fields_T=FIVE))
ONE_PLANE = Kind(Case("one plane", ("io",), 12, (0.0, 0.02, 0.04)))
EFFICIENT = Kind(Case("efficient", ("io", "ip"), 9, TWO_SIDED, passes=2, shuffled=True))
PALINDROME = Kind(
    Case("palindrome", ("io", "ip"), 12, FIVE, passes=2), drift_V=30e-6, warming_K=0.8
)
ASCENDING = Kind(Case("two planes, ascending", ("io", "ip"), 12), drift_V=15e-6)
ON_OFF = Kind(Case("fields 0 and B", ("io", "ip"), 24, (0.0, 0.05)), noise_V=1e-6)
LEVEL = Kind(Case("one plane and level", ("io", "level"), 12, TWO_SIDED))
ONE_FIELD = Kind(Case("one field", ("io", "ip"), 24, (0.05,)))
KINDS = (THREE_PLANES, ONE_PLANE, EFFICIENT, PALINDROME, ASCENDING, ON_OFF, LEVEL, ONE_FIELD)


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


def field_more(change: Callable[[Table], NDArray[Any]]) -> Plant:
    return column("field_T", lambda one: one.field_T + change(one))


def angle(change: Callable[[Table], NDArray[Any]]) -> Plant:
    return column("theta_deg", change)


def warm(change: Callable[[Table], NDArray[Any]]) -> Plant:
    return column("temperature_degC", change)


def limited(limit: float, name: str = "output_V") -> Plant:
    return column(name, lambda one: np.clip(getattr(one, name), -limit, limit))


def rounded(name: str, step: float) -> Plant:
    return column(name, lambda one: step * np.round(getattr(one, name) / step))


def plane_output(change: Callable[[Table, NDArray[np.bool_]], NDArray[Any]]) -> Plant:
    return column("output_V", lambda one: change(one, in_plane(one)))


def growing_noise(one: Table) -> Array:
    """Return noise that grows to ten times its size."""
    growing = one.kind.noise_V * np.linspace(0.0, 10.0, len(one))
    return np.asarray(growing * one.generator.standard_normal(len(one)))


def swapped(first: str, second: str) -> Plant:
    """Two columns stand in each other's place."""

    def plant(one: Table) -> None:
        values = getattr(one, first).copy(), getattr(one, second).copy()
        setattr(one, second, values[0])
        setattr(one, first, values[1])

    return plant


def turned(names: str, where: Callable[[Table], NDArray[Any]]) -> Plant:
    """Columns have the other sign in some rows."""

    def plant(one: Table) -> None:
        sign = np.where(where(one) > 0.0, -1.0, 1.0)
        for name in names.split():
            setattr(one, name, sign * getattr(one, name))

    return plant


def heated(one: Table, rows: float) -> Array:
    """Return what a coil that warms the device by the square of its field adds, zero mean."""
    share = 1.0 - np.exp(-1.0 / rows)
    memory = share * np.exp(-np.arange(len(one)) / rows)
    heat = np.convolve((one.field_T / 0.05) ** 2, memory)[: len(one)]
    return np.asarray(heat - heat.mean())


def averaged(one: Table) -> Array:
    """Return outputs that are each the mean of a row and the one before."""
    return np.asarray(0.5 * (one.output_V + before(one.output_V)))


def warmed_unseen(one: Table) -> Array:
    """Return what 2 K more in one plane do that the thermometer does not show."""
    return np.asarray((50e-6 + 120e-6 * one.axes()[0]) * 2.0 * in_plane(one))


def an_hour_later(one: Table) -> Array:
    """Return times with an hour's pause in mid-course, or a clock that was set."""
    return np.asarray(one.t_s + 3600.0 * (np.arange(len(one)) >= len(one) // 2))
