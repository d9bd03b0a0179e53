"""Columns that mean something else than they say.

Another unit of the angle, another plane, a sign that changes: each mix-up that laboratories make is
tried where the rows do not follow the model at all. One that leaves a small part of what the stated
one leaves is named, and nothing is reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.linear import combine
from procedures.estimation.readings import Reading, Remainder, named, suiting
from station.findings import CONTRADICTS, Flag

from .dataset import Rows
from .model import PLANES, model_columns
from .nuisances import KO, KP, OFFSET
from .solved import Solution

Array = NDArray[np.float64]
Posed = tuple[Array, Array]
"""Columns of model, misalignment and the encoder's zero, (rows, 16), and the output (rows,)."""
UNITS_DEG = {"rad": 180.0 / np.pi, "gon": 0.9, "turns": 360.0, "arcmin": 1 / 60, "arcsec": 1 / 3600}
POOR_PART = 1e-3
"""Noise of this part of the output's range is none of a voltmeter or an accelerometer."""
HOPELESS = 20.0
"""Times as much noise as that, and the model explains nothing; below, the device may be noisy."""
POOR_V = 1e-3
"""The same where no input acceleration spreads the output."""
MANY_STRAYS = 0.2
TILTED = 0.1
"""Of Ki: no accelerometer is mounted 6 deg off."""
TILTED_V_PER_G = 0.05
"""The same where Ki is not measured; the usual scale factor is 0.1 V/g and more."""
LARGE_OFFSET_DEG = 3.0
SIGNED = {"theta_deg": "theta_rad", "field_T": "field_T", "output_V": "output_V"}
"""Columns, by their name in the file, whose sign may change in the course of the rows."""
POSITION = "wrong-position"
RIDGE = 1e-12
"""Of each column's squares: a decomposition of none left fails otherwise."""
ROUNDS = 12


def misread_flags(rows: Rows, solution: Solution) -> tuple[list[Flag], bool]:
    """Return the flags of columns that do not mean what they say, and whether that is certain.

    Where it is, no coefficient can be reported.
    """
    values = solution.values
    poor_V = POOR_PART * float(np.std(rows.output_V)) if "Ki" in values else POOR_V
    noise_V = float(np.sqrt(np.mean(solution.residual_V**2)))
    strays = float(np.mean(~solution.kept))
    offset_deg = values.get(OFFSET, 0.0) / 3600.0
    poor = max(noise_V, solution.noise_V) > poor_V or strays > MANY_STRAYS
    explained = solution.misfit is not None or solution.cause is not None
    if poor or explained or abs(offset_deg) > LARGE_OFFSET_DEG:
        suits = suiting(_posed(rows), [list(_readings(rows))], _remainder)
        if suits:
            text = (
                f"The output is followed only if {named(suits)}. Nothing is reported: correct the "
                "table, or look at the mounting, and analyse it again."
            )
            return [suits[0].reading.flag(text)], True
    tilted = max(abs(values.get(name, 0.0)) for name in (KO, KP))
    if tilted > (TILTED * abs(values["Ki"]) if "Ki" in values else TILTED_V_PER_G):
        tilt_text = (
            f"The output has {tilted:.3g} V/g across the input axis: no mounting is so far off. "
            "Another plane or another zero of the angle was recorded; nothing is reported. Look "
            "at the mounting and at the columns plane and theta_deg."
        )
        return [Flag(POSITION, tilt_text, details={"misalignment_V_per_g": tilted})], True
    if abs(offset_deg) > LARGE_OFFSET_DEG:
        zero_text = (
            f"The zero of the encoder is {offset_deg:.4g} deg off, which the solution corrects: "
            "look whether the accelerometer is mounted as stated."
        )
        return [Flag(POSITION, zero_text, details={"offset_deg": offset_deg})], False
    if solution.noise_V > HOPELESS * poor_V or strays > MANY_STRAYS:
        astray_text = (
            f"The output does not follow angle and field: {100.0 * strays:.2g} % of the rows are "
            f"left out, and the others miss the model by {1e6 * solution.noise_V:.3g} µV. No one "
            "cause explains that. Look at the columns, their units and their order."
        )
        return [Flag("misfit", astray_text, details={"what": "rows", "part": strays})], False
    return [], False


def _readings(rows: Rows) -> Iterator[Reading[Posed]]:
    """Yield other readings of the rows."""
    theta, output_V, plane = rows.theta_rad, rows.output_V, rows.plane

    def read(
        what: str, statement: str, code: str = CONTRADICTS, **columns: NDArray[Any]
    ) -> Reading[Posed]:
        other = replace(rows, **columns)  # type: ignore[arg-type]
        return Reading(what, lambda _: _posed(other), statement, {}, code)

    for unit, factor in UNITS_DEG.items():
        yield read(f"theta_deg is in {unit}", "theta_deg", theta_rad=factor * theta)
    late, early = np.append(output_V[1:], output_V[-1]), np.append(output_V[0], output_V[:-1])
    yield read("output_V stands one row late", "output_V", output_V=late)
    yield read("output_V stands one row early", "output_V", output_V=early)
    for part in np.linspace(0.1, 0.9, 9):
        what = f"output_V holds about {100.0 * part:.0f} % of the row before"
        yield Reading(what, partial(_run_together, float(part)), "output_V")
    signs = lost_signs(rows)
    if signs is not None:
        what = "field_T and field_commanded_T hold the size of the field without its sign"
        yield read(what, "field_T", field_T=signs * np.abs(rows.field_T))
    for statement, name in SIGNED.items():
        turned = replace(rows, **{name: -getattr(rows, name)})
        row = _turning_row(_posed(rows), _posed(turned))
        mixed = np.where(np.arange(len(theta)) < row, 1.0, -1.0) * getattr(rows, name)
        what = (
            f"{statement} has the other sign from row {row} of the usable rows on, counted from 0"
        )
        yield read(what, statement, **{name: mixed})
    names = [str(name) for name in np.unique(plane)]
    for name in names if len(names) > 1 else ():
        there = plane == name
        for column in ("field_T", "output_V"):
            turned = np.where(there, -1.0, 1.0) * getattr(rows, column)
            what = f"{column} has the other sign in plane {name}"
            yield read(what, column, **{column: turned})
        what, other = f"plane {name} turns in the other sense", np.where(there, -theta, theta)
        yield read(what, "plane", POSITION, theta_rad=other)
        for deg in (90, 180, 270):
            what, other = f"plane {name} is turned by {deg} deg", theta + np.radians(deg) * there
            yield read(what, "plane", POSITION, theta_rad=other)
    for name in names:
        for new in PLANES:
            if new != name:
                other_plane = np.where(plane == name, new, plane)
                yield read(f"plane {name} is {new}", "plane", POSITION, plane=other_plane)
    for name, new in combinations(names, 2):
        swapped = np.where(plane == new, name, np.where(plane == name, new, plane))
        what = f"the planes {name} and {new} are exchanged"
        yield read(what, "plane", POSITION, plane=swapped)


def _posed(rows: Rows) -> Posed:
    acceleration_g = rows.accelerations()
    model = model_columns(acceleration_g, rows.field_T)
    columns = np.column_stack((model, acceleration_g[:, 1:], rows.slope))
    size = np.linalg.norm(columns, axis=0)
    return columns / np.where(size > 0.0, size, 1.0), rows.output_V


def _run_together(part: float, posed: Posed) -> Posed:
    """Return an output that holds a part of the row before."""
    columns, output_V = posed
    before = np.vstack((columns[:1], columns[:-1]))
    return (1.0 - part) * columns + part * before, output_V


def _fitted(posed: Posed) -> tuple[Array, Array]:
    """Return the coefficients of the columns (16,), and what they leave of the output (rows,)."""
    columns, output_V = posed
    coefficients = np.asarray(np.linalg.lstsq(columns, output_V, rcond=1e-9)[0])
    return coefficients, output_V - combine(columns, coefficients)


def _remainder(posed: Posed) -> Remainder:
    left_V = _fitted(posed)[1]
    return Remainder(float(left_V @ left_V), max(len(left_V) - posed[0].shape[1], 1))


def _turning_row(stated: Posed, turned: Posed) -> int:
    """Return from which row on the turned columns leave the smallest squares."""
    first, second = (
        both[:, :, None] * both[:, None, :]
        for both in (np.column_stack(posed) for posed in (stated, turned))
    )
    products = np.cumsum(first - second, axis=0)[:-1] + second.sum(axis=0)
    places = np.arange(products.shape[1])
    products[:, places, places] *= 1.0 + RIDGE
    products[:, places, places] += RIDGE
    return 1 + int(np.argmin(np.linalg.cholesky(products)[:, -1, -1]))


def lost_signs(rows: Rows) -> Array | None:
    """Return the signs of a field without signs that suit the rows best; None where it has signs.

    A row has one of two outputs, the model's at the field or at its opposite. From a first guess
    signs and coefficients are found in turn, each row taking the sign that leaves it less.
    """
    commanded_T = rows.commanded_T
    one_sided = float(commanded_T.min()) >= 0.0 or float(commanded_T.max()) <= 0.0
    if not one_sided or not commanded_T.any():
        return None
    left_V = _fitted(_posed(rows))[1]
    went = np.cumsum(np.diff(np.abs(commanded_T), prepend=0.0) > 0.0) % 2
    by_input = left_V * np.where(rows.accelerations()[:, 0] < 0.0, -1.0, 1.0)
    settled: list[tuple[float, int, Array]] = []
    for begin in (left_V, by_input, 2.0 * went - 1.0):
        signs = np.where(begin < 0.0, -1.0, 1.0)
        for _ in range(ROUNDS):
            signed = replace(rows, field_T=signs * np.abs(rows.field_T))
            coefficients, left_V = _fitted(_posed(signed))
            turned, _ = _posed(replace(rows, field_T=-signed.field_T))
            better = np.abs(rows.output_V - combine(turned, coefficients)) < np.abs(left_V)
            if not better.any():
                break
            signs = np.where(better, -signs, signs)
        settled.append((float(left_V @ left_V), len(settled), signs))
    return min(settled)[2]
