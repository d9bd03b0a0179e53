"""What else may have moved the output: a table of causes, each with the columns it would have.

Each is held against what a solution left (`estimation.alternatives`), with drift and without, in
all rows and in those that the solution keeps; the information criterion then says which it was: an
encoder that jumps, drift, or one of these.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.alternatives import (
    SEARCHED,
    Alternative,
    Score,
    doubt,
    scores,
    strongest_line,
    worth_trying,
)
from procedures.estimation.linear import combine
from station.findings import Flag

from .dataset import Rows
from .history import direction, tells_history, warmth
from .jump import Suspects, small_jumps
from .model import model_columns
from .nuisances import ARCSEC_PER_RAD, OFFSET
from .solved import Solution, Solved

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DEAR = SEARCHED + 2
DEARLY = {"plane", "encoder"}
"""Planes, angles and gains go with time, and drift and temperature with all of them."""
WARMING_ROWS = (4.0, 12.0, 36.0)
"""Time constants of a device in a coil, in intervals of the rows."""
LIKE_HYSTERESIS = Flag(
    "misfit",
    "Each field always comes after the same one, so that what hysteresis leaves is a shape over "
    "the field: a core that saturates, or another shape that the model does not have, may be the "
    "cause as well. Take the fields up and down, or in random order, which distinguishes the two.",
)
STEP_KEYS = {"V": "step_V", "V/g": "step_V_per_g", "V/T": "step_V_per_T"}


def known_causes(rows: Rows, acceleration_g: Array, coefficients: Array) -> list[Alternative]:
    """Return the causes that have a shape of their own.

    `acceleration_g` (rows, 3), `coefficients` (13,) of a first solution.
    """
    data = rows.output_V
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
        ("hysteresis", "bias", "V", np.column_stack((up, up * b**2))),
        ("hysteresis", "scale", "V/g", up * i),
        ("hysteresis", "last field", "V/T", change_T),
        ("hysteresis", "last field", "1", change_T * by_field),
        ("not-settled", "output", "1", data[last] - data),
        ("field-differs-from-commanded", "gaussmeter", "1", off_T * by_field),
        ("misfit", "field", "V", b**3),
        ("misfit", "field", "V", np.abs(b) * b),
        ("misfit", "field", "V", b**4),
        ("misfit", "field", "V", np.column_stack((b**3, b**4))),
        ("misfit", "field and acceleration", "V/g", i * b**2),
        ("misfit", "field's sign and acceleration", "V/g", i * np.sign(b)),
        ("misfit", "field's sign and acceleration", "V/g", i * np.abs(b)),
        ("misfit", "acceleration", "V/g", np.abs(i)),
        ("misfit", "acceleration", "V/g^2", np.abs(i) * i),
        ("misfit", "acceleration", "V/g^4", i**4),
        ("misfit", "acceleration", "V/g^5", i**5),
        ("misfit", "acceleration", "V/g^2", o * p),
        ("misfit", "scale of the encoder", "V/g", rows.slope * rows.theta_rad),
        ("misfit", "drift of the encoder", "V/g", rows.slope * time),
        ("drift-removed", "Km", "V", time * b),
    ]
    if tells_history(rows.commanded_T):
        for constant in WARMING_ROWS:
            shapes += [("not-settled", f"{constant:g}", "V", warmth(rows, constant))]
    if rows.temperature_degC is not None:
        square = time**2 - np.mean(time**2)
        shapes += [
            ("drift-removed", "Ki", "V/g", time * i),
            ("drift-removed", "Ki", "V/g", np.column_stack((time * i, square * i))),
        ]
    for plane in np.unique(rows.plane):
        if np.count_nonzero(np.diff(rows.plane == plane)) < 2:
            continue  # It begins or ends once, as a step does.
        there = (rows.plane == plane) - float(np.mean(rows.plane == plane))
        shapes += [("output-step", f"plane {plane}", "V", there)]
        shapes += [("output-step", f"gain of plane {plane}", "V/g", there * i)]
    return [
        Alternative(
            code,
            what,
            unit,
            columns.reshape(len(data), -1),
            None,
            DEAR if DEARLY & set(what.split()) else 1,
        )
        for code, what, unit, columns in shapes
    ]


def causes_to_try(
    solved: Solved, rows: Rows, suspects: Suspects, known: list[Alternative]
) -> list[Alternative]:
    """Return the causes that explain more than noise does; none where nothing looks like it.

    Drift takes a step's place, so each is looked for with slow terms and without.
    """
    causes: dict[bytes, Alternative] = {}
    kept = solved.solution.kept
    masks = (kept,) if kept.all() else (kept, np.ones_like(kept))
    slow = solved.slow.shape[1]
    still = solved.design[:, : solved.design.shape[1] - slow]
    for columns in (solved.design, still)[: 1 + slow]:
        for inside in masks:
            for cause in worth_trying(_scores(columns, solved, rows, suspects, known, inside)):
                causes.setdefault(cause.columns.tobytes(), cause)
    return list(causes.values())


def with_doubt(solved: Solved, rows: Rows, suspects: Suspects, known: list[Alternative]) -> Solved:
    """Return a solution whose uncertainties hold a cause that noise may just imitate."""
    kept, solution = solved.solution.kept, solved.solution
    if solution.cause is not None or solution.jump is not None:
        return solved
    units = np.ones(solved.design.shape[1])
    units[[solution.names.index(name) for name in (OFFSET,) if name in solution.names]] = (
        ARCSEC_PER_RAD
    )
    rated = _scores(solved.design, solved, rows, suspects, known, kept)
    u = np.sqrt(np.diag(solution.covariance)) / units
    moved = doubt(solved.design, rows.output_V, kept, rated, u) * units
    covariance = solution.covariance + np.outer(moved, moved)
    return replace(solved, solution=replace(solution, covariance=covariance))


def _scores(
    columns: Array,
    solved: Solved,
    rows: Rows,
    suspects: Suspects,
    known: list[Alternative],
    inside: Mask,
) -> list[Score]:
    """Return the score of each cause against `columns` (rows, k); only rows `inside` count."""
    input_g = solved.acceleration_g[:, 0]

    def steps(design: Array, left: Array, inside: Mask) -> list[tuple[float, Alternative]]:
        return _steps(suspects, design, left, inside, input_g, rows.field_T)

    def lines(design: Array, left: Array, inside: Mask) -> list[tuple[float, Alternative]]:
        return strongest_line(rows.time_s, design, left, inside, "V")

    return scores(columns, rows.output_V, inside, known, (steps, lines))


def _steps(
    suspects: Suspects, design: Array, left: Array, inside: Mask, input_g: Array, field_T: Array
) -> list[tuple[float, Alternative]]:
    """Return the best step of the output and of its gain, each of zero mean over the rows."""
    begins, _ = suspects.kinds(inside)
    steps = []
    shapes = (
        ("output", "V", np.ones(len(left)), SEARCHED),
        ("gain", "V/g", input_g, DEAR),
        ("sensitivity", "V/T", field_T, DEAR),
    )
    for what, unit, shape, places in shapes:
        gains = np.where(begins, small_jumps(suspects, design, shape * inside, left)[0], 0.0)
        row = int(np.argmax(gains))
        after = (np.arange(len(left)) >= row).astype(np.float64)
        columns = (shape * (after - after.mean()))[:, None]
        steps.append(
            (float(gains[row]), Alternative("output-step", what, unit, columns, row, places))
        )
    return steps


def cause_flag(solution: Solution, cause: Alternative, rows: NDArray[np.int64]) -> Flag:
    """Return the flag of what moved the output beside the model; `rows` are those of the dataset.

    Its size is the largest change of the output that it makes over the rows.
    """
    terms = solution.coefficients[[solution.names.index(name) for name in cause.names]]
    size_V = float(np.ptp(np.einsum("ij,j->i", cause.columns, terms)))
    first, size = float(terms[0]), f"{1e6 * size_V:.3g} µV"
    details: dict[str, object] = {"what": cause.what, "size_V": size_V}
    if cause.code == "hysteresis":
        moved = {
            "bias": "the output differs by where the field came from",
            "scale": "the scale factor differs by where the field came from",
            "last field": "the output still holds a part of the field of the row before",
        }[cause.what]
        text = (
            f"Hysteresis: {moved}, by up to {size}; it is fitted and removed. A core or a torquer "
            "keeps a part of its magnetisation, or the field had not settled: degauss before each "
            "point, wait longer, and compare field up with field down."
        )
    elif cause.code == "not-settled" and cause.what != "output":
        text = (
            f"The output follows the square of the field with a delay of about {cause.what} rows, "
            f"by up to {size}: the coil warms the device, and no temperature says so; it is fitted "
            "and removed. Look at the thermometer's place, wait longer at each point, and cool the "
            "coil."
        )
    elif cause.code == "not-settled":
        text = (
            f"Each output holds {100.0 * first:.2g} % of the one before: it was read before it had "
            "settled, or stands in the wrong row. The solution corrects a small part. Lengthen "
            "the dwell, and look at the filter of the voltmeter and at the rows."
        )
        details = {"part": first}
    elif cause.code == "field-differs-from-commanded":
        text = (
            f"The output follows the commanded field, not the gaussmeter, by {first:.2f} "
            f"of their difference (up to {size}); the solution corrects that. Look at the "
            "gaussmeter: its range, zero, cable and place, and whether its column is shifted."
        )
    elif cause.code == "periodic":
        text = (
            f"The output has a line with a period of {cause.what} and a range of {size}, which is "
            "fitted and removed: mains pick-up or another disturbance, aliased by the interval "
            "of the rows. Look at grounding, shields and the integration time of the voltmeter."
        )
    elif cause.code == "drift-removed":
        text = (
            f"{cause.what} drifted in the course of the rows (up to {size} of the output), and no "
            "temperature says why; terms of zero mean were fitted and removed. Look at the "
            "thermometer's place, and warm the device up for longer."
        )
        details = {"term": cause.what}
    elif cause.code == "misfit":
        text = (
            f"The output has a shape that the model does not have, by {cause.what} (up to {size}); "
            "one term for it is fitted, and what it leaves is not known. Look for a saturated "
            "core, a voltmeter that is not linear, and an encoder's scale."
        )
    else:
        where, than = f"In {cause.what.removeprefix('gain of ')}", "in the others"
        details = {STEP_KEYS[cause.unit]: first}
        if cause.row is not None:
            row = int(rows[cause.row])
            where, than = f"From row {row} on, counted from 0,", "before"
            details["row"] = row
        text = (
            f"{where} the output reads {1e6 * first:+.4g} µ{cause.unit} more than {than} at the "
            "same angle and field; the solution takes the step for one of the output and removes "
            "it, K0 and Ki being the mean. Look at the voltmeter, its range and input, and the "
            "device."
        )
    return Flag(cause.code, text, details=details)
