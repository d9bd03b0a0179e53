"""What a laboratory may do to accelerometer records: what faults are made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from accelerometer_records import INTERVAL_S, TRUTH, axes_g
from accelerometer_tables import Plant, Table
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
