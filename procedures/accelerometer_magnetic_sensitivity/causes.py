"""What else may have moved the output: a table of causes, each with the columns it would have.

Each is held against what a solution left, with drift and without, in all rows and in those that the
solution keeps. Those that explain far more than noise does are solved for beside the coefficients,
and the information criterion says which it was: an encoder that jumps, drift, or one of these.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, ndtr

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import independent_of, project, solve_by_qr, thin_qr

from .jump import Suspects, small_jumps
from .model import model_columns
from .rows import Rows
from .solved import PLACE, Cause, Solved

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RARE = 2.0 * float(ndtr(-4.5))
"""As seldom as this noise may look so much like a cause that it is tried."""
LEAST_PART = 1e-2
"""A column with less of its own takes the place of the coefficients it resembles."""
MOST_TRIED = 3
FEWEST_LEFT = 6
SLOWEST_CYCLES = 4.5
"""What is slower in the record is drift."""


def direction(commanded_T: Array) -> Array:
    """Return +1 where the field has come up last, -1 where it has come down, 0 before it moved."""
    steps = np.sign(np.diff(commanded_T, prepend=commanded_T[:1]))
    moved = np.maximum.accumulate(np.where(steps != 0.0, np.arange(len(steps)), 0))
    return np.asarray(steps[moved])


def known_causes(
    rows: Rows, acceleration_g: Array, coefficients: Array, data: Array
) -> list[Cause]:
    """Return the causes that have a shape of their own.

    `acceleration_g` (rows, 3), `coefficients` (13,) of a first solution, `data` (rows,) in V.
    """
    i, o, p = acceleration_g.T
    largest_T = float(np.max(np.abs(rows.field_T))) or 1.0
    b = rows.field_T / largest_T
    time = rows.time_s - rows.time_s.mean()
    time = time / (float(np.max(np.abs(time))) or 1.0)
    up = direction(rows.commanded_T)
    ahead = model_columns(acceleration_g, rows.field_T + largest_T)
    behind = model_columns(acceleration_g, rows.field_T - largest_T)
    by_field = combine(ahead - behind, coefficients) / (2.0 * largest_T)
    last = np.concatenate(([0], np.arange(len(data) - 1)))
    change_T = rows.field_T[last] - rows.field_T
    off_T = rows.commanded_T - rows.field_T
    shapes: list[tuple[str, str, str, Array]] = [
        ("hysteresis", "bias", "V", up),
        ("hysteresis", "bias", "V", up * (1.0 - b**2)),
        ("hysteresis", "scale", "V/g", up * i),
        ("hysteresis", "last field", "V/T", change_T),
        ("hysteresis", "last field", "1", change_T * by_field),
        ("not-settled", "output", "1", data[last] - data),
        ("field-differs-from-commanded", "gaussmeter", "1", off_T * by_field),
        ("misfit", "field", "V", b**3),
        ("misfit", "field", "V", np.abs(b) * b),
        ("misfit", "field and acceleration", "V/g", i * b**2),
        ("misfit", "acceleration", "V/g", np.abs(i)),
        ("misfit", "acceleration", "V/g^2", np.abs(i) * i),
        ("misfit", "acceleration", "V/g^4", i**4),
        ("misfit", "acceleration", "V/g^5", i**5),
        ("misfit", "acceleration", "V/g^2", o * p),
        ("misfit", "scale of the encoder", "V/g", rows.slope * rows.theta_rad),
        ("misfit", "drift of the encoder", "V/g", rows.slope * time),
        ("drift-removed", "Km", "V", time * b),
    ]
    if rows.temperature_degC is not None:
        square = time**2 - np.mean(time**2)
        shapes += [
            ("drift-removed", "Ki", "V/g", time * i),
            ("drift-removed", "Ki", "V/g", np.column_stack((time * i, square * i))),
        ]
    planes = np.unique(rows.plane)
    for plane in planes if len(planes) > 1 else []:
        there = (rows.plane == plane) - float(np.mean(rows.plane == plane))
        shapes += [("output-step", f"plane {plane}", "V", there)]
        shapes += [("output-step", f"gain of plane {plane}", "V/g", there * i)]
    return [Cause(code, what, unit, one.reshape(len(data), -1)) for code, what, unit, one in shapes]


def causes_to_try(
    solved: Solved, rows: Rows, data: Array, suspects: Suspects, known: list[Cause]
) -> list[Cause]:
    """Return the causes that explain more than noise does; none where nothing looks like it.

    Drift takes a step's place, so each is looked for with slow terms and without.
    """
    input_g = solved.acceleration_g[:, 0]
    found: dict[bytes, tuple[float, Cause]] = {}
    everything = np.ones(len(data), dtype=bool)
    slow = solved.slow.shape[1]
    still = solved.design[:, : solved.design.shape[1] - slow]
    for columns in (solved.design, still)[: 1 + slow]:
        for inside in (solved.solution.kept, everything):
            if int(inside.sum()) - columns.shape[1] < FEWEST_LEFT:
                continue
            fit = solve_by_qr(columns[inside], data[inside])
            left = (data - combine(columns, fit.coefficients)) * inside
            design = columns * inside[:, None]
            free = int(inside.sum()) - columns.shape[1]
            tried = [_explained(one, design, left, inside) for one in known]
            tried += _steps(suspects, design, left, inside, input_g, rows.field_T)
            tried += _lines(rows.time_s, design, left, inside)
            for gain, one in tried:
                width = one.columns.shape[1]
                if not width:
                    continue
                rest = max(float(left @ left) - gain, 1e-300) / (free - width)
                chance = float(fdtrc(width, free - width, gain / width / rest))
                key = one.columns.tobytes()
                if chance < RARE and chance < found.get(key, (1.0, one))[0]:
                    found[key] = (chance, one)
    return [one for _, one in sorted(found.values(), key=lambda x: x[0])[:MOST_TRIED]]


def _explained(cause: Cause, design: Array, left: Array, inside: Mask) -> tuple[float, Cause]:
    """Return by how much the squares fall with a cause, and the cause with what is its own."""
    own = independent_of(design, cause.columns * inside[:, None], LEAST_PART)
    columns = cause.columns[:, list(own)]
    q = thin_qr(np.column_stack((design, columns * inside[:, None])))[0][:, design.shape[1] :]
    return float(np.sum(project(q, left) ** 2)), replace(cause, columns=columns)


def _steps(
    suspects: Suspects, design: Array, left: Array, inside: Mask, input_g: Array, field_T: Array
) -> list[tuple[float, Cause]]:
    """Return the best step of the output and of its gain, each of zero mean over the rows."""
    begins, _ = suspects.kinds(inside)
    found = []
    shapes = (("output", "V", np.ones(len(left))), ("gain", "V/g", input_g))
    for what, unit, shape in (*shapes, ("sensitivity", "V/T", field_T)):
        gains = np.where(begins, small_jumps(suspects, design, shape * inside, left)[0], 0.0)
        row = int(np.argmax(gains))
        after = (np.arange(len(left)) >= row).astype(np.float64)
        columns = (shape * (after - after.mean()))[:, None]
        found.append((float(gains[row]), Cause("output-step", what, unit, columns, row, PLACE)))
    return found


def _lines(time_s: Array, design: Array, left: Array, inside: Mask) -> list[tuple[float, Cause]]:
    """Return the strongest line in what a solution left, none where rows are too few."""
    count = len(left)
    spacing_s = float(np.median(np.diff(time_s)))
    span = float(time_s[-1] - time_s[0]) / spacing_s
    cycles = np.arange(SLOWEST_CYCLES, 0.5 * span, 0.5) / span
    if not len(cycles) or spacing_s <= 0.0:
        return []
    phase = 2.0 * np.pi * np.outer((time_s - time_s[0]) / spacing_s, cycles)
    waves = np.stack((np.cos(phase), np.sin(phase)))
    q = thin_qr(design)[0]
    own = waves * inside[:, None]
    own = own - np.einsum("nk,akc->anc", q, np.einsum("nk,anc->akc", q, own))
    (cc, ss), cs = np.einsum("anc,anc->ac", own, own), np.einsum("nc,nc->c", *own)
    cr, sr = np.einsum("anc,n->ac", own, left)
    determinant = cc * ss - cs**2
    told = determinant > (LEAST_PART * count) ** 2
    gains = (ss * cr**2 - 2.0 * cs * cr * sr + cc * sr**2) / np.where(told, determinant, 1.0)
    best = int(np.argmax(np.where(told, gains, 0.0)))
    if not told[best]:
        return []
    what = f"{spacing_s / cycles[best]:.4g} s"
    return [(float(gains[best]), Cause("periodic", what, "V", waves[:, :, best].T, None, PLACE))]
